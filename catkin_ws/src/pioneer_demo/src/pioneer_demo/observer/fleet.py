"""State of the whole fleet as seen by the demo, and its evaluation."""

import dataclasses
import math

from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.scenario.scenario import Success


@dataclasses.dataclass
class Simulator:
    """The simulator's newest state: readiness, simulated time [s], real-time factor."""

    ready: bool = False
    time: float = 0.0
    real_time_factor: float = math.nan


@dataclasses.dataclass
class Traffic:
    """Message and byte counts on the base station's gateway connections since the last `restart`."""

    messages: int = 0  #: in both directions; calls for services
    bytes: int = 0  #: size of the messages before compression
    _seen: dict[str, tuple[int, int]] = dataclasses.field(default_factory=dict)

    def add(self, connection: str, messages: int, size: int) -> None:
        """Adds a connection's counters, which restart from 0 when it reconnects."""
        before = self._seen.get(connection, (0, 0))
        if messages < before[0]:
            before = (0, 0)
        self._seen[connection] = (messages, size)
        self.messages += messages - before[0]
        self.bytes += size - before[1]

    def restart(self) -> None:
        """Resets the counts to 0."""
        self.messages = self.bytes = 0


@dataclasses.dataclass
class Fleet:
    """All robots and their simulator."""

    robots: list[RobotTrack]  #: one track per robot, robot 1 first
    simulator: Simulator = dataclasses.field(default_factory=Simulator)  #: its newest state
    began: float = math.nan  #: simulated time when the waypoints were sent [s]; nan before
    #: simulated time when the last waypoint was reached or given up, or the demo was aborted [s]; nan before
    ended: float = math.nan
    closest: float = (
        math.inf
    )  #: smallest centre distance of two robots so far [m]; infinite with one robot
    traffic: Traffic = dataclasses.field(
        default_factory=Traffic
    )  #: network traffic between base station and robots

    def note_distance(self, robot: RobotTrack) -> None:
        """Updates the closest approach after ``robot`` has moved."""
        others = [other.pose for other in self.robots if other is not robot and other.pose]
        if robot.pose and others:
            self.closest = min(self.closest, *(robot.pose.distance(other) for other in others))

    @property
    def finished(self) -> bool:
        """Whether every robot has reached or given up every waypoint."""
        return all(robot.finished for robot in self.robots)


def faults(fleet: Fleet, success: Success) -> list[str]:
    """Returns one line per unmet success criterion; empty on success."""
    lines = []
    for robot in fleet.robots:
        if robot.reached < success.reached * len(robot.visits):
            lines.append(f"{robot.name} reached {robot.reached} of {len(robot.visits)} waypoints")
        if robot.collisions > success.collisions:
            lines.append(f"{robot.name} collided {times(robot.collisions)}")
        most, (_, error, _) = success.localisation_error, robot.error_statistics()
        if most is not None and not error <= most:
            lines.append(
                f"{robot.name}: localisation error of {error:.3f} m (95th percentile), above {most:g} m"
            )
    if success.seconds is not None and not fleet.ended - fleet.began <= success.seconds:
        lines.append(f"it took {fleet.ended - fleet.began:.1f} s, above {success.seconds:g} s")
    if fleet.closest < success.closest_approach:
        lines.append(
            f"two robots came within {fleet.closest:.2f} m, below {success.closest_approach:g} m"
        )
    return lines


def time_limit(fleet: Fleet) -> float:
    """Returns the simulated time [s] after which the fleet counts as stuck, based on its longest route.

    Assumes 0.25 m/s, while a Pioneer in corridors averages 0.4 m/s or more, and adds 30 s per waypoint for encounters.
    """
    return max(
        (
            60.0 + sum(visit.leg.length / 0.25 + 30.0 for visit in robot.visits)
            for robot in fleet.robots
        ),
        default=0.0,
    )


def stuck_report(fleet: Fleet, limit: float) -> str:
    """Returns a report with one line per unfinished robot: its position and status."""
    lines = [f"not finished after {limit:.0f} simulated seconds:"]
    for robot in fleet.robots:
        if not robot.finished:
            where = f"at ({robot.pose.x:.2f}, {robot.pose.y:.2f})" if robot.pose else "never seen"
            said = [
                robot.queue.text if robot.queue else "its waypoint client has not reported",
                robot.status,
            ]
            words = "; ".join(text for text in said if text)
            lines.append(
                f"  {robot.name} {where}, waypoint {robot.current + 1}/{len(robot.visits)}: {words}"
            )
    return "\n".join(lines)


def times(count: int) -> str:
    """Returns ``count`` as an adverb: once, twice, 3 times."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")
