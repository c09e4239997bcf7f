"""The whole fleet as the demo sees it, and the verdict on it."""

import dataclasses
import math

from pioneer_demo.core.scenario import Success
from pioneer_demo.core.track import RobotTrack
from pioneer_demo.core.traffic import Traffic


@dataclasses.dataclass
class Simulator:
    """The simulator's newest figures: simulated time [s] and real-time factor, and all factors seen since the start."""

    ready: bool = False
    time: float = 0.0
    real_time_factor: float = math.nan


@dataclasses.dataclass
class Fleet:
    """All robots and their simulator."""

    robots: list[RobotTrack]  #: one track each, robot 1 first
    simulator: Simulator = dataclasses.field(default_factory=Simulator)  #: its newest figures
    began: float = math.nan  #: simulated time when the waypoints were sent [s]; nan before
    #: simulated time when the last of them was dealt with, or the demo ended otherwise [s]; nan before
    ended: float = math.nan
    closest: float = math.inf  #: smallest distance between the middles of two robots so far [m]; infinite with one
    traffic: Traffic = dataclasses.field(default_factory=Traffic)  #: what crosses between base station and robots

    def note_distance(self, robot: RobotTrack) -> None:
        """Takes in how far a robot, which has just moved, is from the others."""
        others = [other.pose for other in self.robots if other is not robot and other.pose]
        if robot.pose and others:
            self.closest = min(self.closest, *(robot.pose.distance(other) for other in others))

    @property
    def finished(self) -> bool:
        """Whether every robot has reached or given up every waypoint."""
        return all(robot.finished for robot in self.robots)


def faults(fleet: Fleet, success: Success) -> list[str]:
    """Returns what keeps a demo from being a success, a line each; none when it is one."""
    lines = []
    for robot in fleet.robots:
        if robot.reached < success.reached * len(robot.visits):
            lines.append(f"{robot.name} reached {robot.reached} of {len(robot.visits)} waypoints")
        if robot.collisions > success.collisions:
            lines.append(f"{robot.name} collided {times(robot.collisions)}")
        most, (_, error, _) = success.localisation_error, robot.error_statistics()
        if most is not None and not error <= most:
            lines.append(f"{robot.name}: localisation error of {error:.3f} m (95th percentile), above {most:g} m")
    if success.seconds is not None and not fleet.ended - fleet.began <= success.seconds:
        lines.append(f"it took {fleet.ended - fleet.began:.1f} s, above {success.seconds:g} s")
    if fleet.closest < success.closest_approach:
        lines.append(f"two robots came within {fleet.closest:.2f} m, below {success.closest_approach:g} m")
    return lines


def time_limit(fleet: Fleet) -> float:
    """Returns the simulated time [s] that the longest of the fleet's ways may take at most.

    A Pioneer in corridors manages 0.4 m/s or more on the whole; half a minute a waypoint is left for meetings.
    """
    return max(
        (60.0 + sum(visit.leg.length / 0.25 + 30.0 for visit in robot.visits) for robot in fleet.robots), default=0.0
    )


def stuck_report(fleet: Fleet, limit: float) -> str:
    """Returns one line a robot that is still under way: where it is and what it says."""
    lines = [f"not finished after {limit:.0f} simulated seconds:"]
    for robot in fleet.robots:
        if not robot.finished:
            where = f"at ({robot.pose.x:.2f}, {robot.pose.y:.2f})" if robot.pose else "never seen"
            said = [robot.queue.text if robot.queue else "its waypoint client has not reported", robot.status]
            words = "; ".join(text for text in said if text)
            lines.append(f"  {robot.name} {where}, waypoint {robot.current + 1}/{len(robot.visits)}: {words}")
    return "\n".join(lines)


def times(count: int) -> str:
    """Returns ``count`` in words for a sentence: once, twice, 3 times."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")
