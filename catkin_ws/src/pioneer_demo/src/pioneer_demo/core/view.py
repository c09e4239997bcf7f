"""The texts people read while the demo runs."""

import math

from pioneer_demo.core.fleet import Fleet, Simulator
from pioneer_demo.core.track import ClientState, RobotTrack

_WORDS = {
    ClientState.IDLE: "waiting",
    ClientState.WAITING_FOR_MOVE_BASE: "waiting for move_base",
    ClientState.DRIVING: "driving",
}


def live_lines(fleet: Fleet) -> list[str]:
    """Returns a line for the simulator and one for each robot."""
    return [simulator_line(fleet.simulator), *(robot_line(robot) for robot in fleet.robots)]


def simulator_line(simulator: Simulator) -> str:
    """Returns simulated time and real-time factor."""
    return f"simulator  {simulator.time:7.1f} s   real-time factor {number(simulator.real_time_factor, 2)}"


def robot_line(robot: RobotTrack) -> str:
    """Returns state, waypoint, distance to go, localisation error and collisions of one robot."""
    count = len(robot.visits)
    parts = [
        f"{robot.name:<10} {state_word(robot):<21}",
        f"waypoint {min(robot.current + 1, count)}/{count}",
        f"{number(robot.distance_to_go, 1, 5)} m to go",
        f"localisation error {number(robot.error, 2)} m",
    ]
    if robot.collisions:
        parts.append(f"collisions {robot.collisions}")
    return "  ".join(parts)


def state_word(robot: RobotTrack) -> str:
    """Returns what a robot is doing, in a word or three."""
    if robot.finished:
        return "done" if robot.reached == len(robot.visits) else f"gave up {len(robot.visits) - robot.reached}"
    if robot.pose is None:
        return "not spawned"
    if not robot.localised:
        return "waiting for amcl"
    return _WORDS[robot.queue.state] if robot.queue else "waiting for client"


def number(value: float, digits: int, width: int = 0) -> str:
    """Returns a number with so many decimals, a dash where there is none."""
    return f"{'–' if math.isnan(value) else format(value, f'.{digits}f'):>{width}}"
