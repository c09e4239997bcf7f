"""Texts shown to users while a fleet runs, and its status for ``./pioneer status``."""

import math
from pathlib import Path
from typing import Any

from pioneer_demo.observer.fleet import Fleet, Simulator
from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.processes.command import Ports, master_uri
from pioneer_demo.scenario.option import FleetConfig

_BAR = 24

_GUIDE = """\
{robots} in {world} after {seconds:.1f} s. Ctrl-C ends everything.

  ./pioneer status             one line a robot (--json)
  ./pioneer rviz               RViz of the fleet
  ./pioneer teleop {first:<12}drive a robot by keyboard

For other ROS commands, in ./pioneer shell:

{masters}

  rostopic pub -1 /{first}/map_goal geometry_msgs/Twist '[1.0, 1.0, 0.0]' '[0.0, 0.0, 90.0]'   # on {first}'s master
"""


def guide(config: FleetConfig, ports: Ports, seconds: float) -> str:
    """Returns usage instructions for a running fleet; start-up took ``seconds``."""
    names = ["base station", *config.names]
    uris = map(master_uri, (ports.hub_gateway_master, *ports.robot_masters))
    masters = "\n".join(
        f"  export ROS_MASTER_URI={uri}   # {name}" for name, uri in zip(names, uris, strict=True)
    )
    robots = "1 robot is ready" if config.robots == 1 else f"{config.robots} robots are ready"
    return _GUIDE.format(
        robots=robots,
        world=config.map_name,
        first=config.names[0],
        seconds=seconds,
        masters=masters,
    )


def live_lines(fleet: Fleet) -> list[str]:
    """Returns a demo's status lines: waypoint progress, the simulator, and each robot."""
    return [
        progress_line(fleet),
        simulator_line(fleet.simulator),
        *(robot_line(robot) for robot in fleet.robots),
    ]


def fleet_lines(fleet: Fleet) -> list[str]:
    """Returns the status lines of a fleet without a demo: the simulator and each robot."""
    return [simulator_line(fleet.simulator), *(idle_line(robot) for robot in fleet.robots)]


def progress_line(fleet: Fleet) -> str:
    """Returns a progress bar over all waypoints of all robots."""
    done, count = (
        sum(robot.current for robot in fleet.robots),
        sum(len(robot.visits) for robot in fleet.robots),
    )
    full = _BAR * done // max(1, count)
    return f"waypoints  [{'#' * full}{'-' * (_BAR - full)}]  {done} of {count}"


def idle_line(robot: RobotTrack) -> str:
    """Returns one robot's state, position, waypoints, localisation error and collisions."""
    place = f"({robot.pose.x:6.2f}, {robot.pose.y:6.2f})" if robot.pose else "(     –,      –)"
    counts = f"{robot.queue.reached} of {robot.queue.received}" if robot.queue else "–"
    collisions = f"  collisions {robot.collisions}" if robot.collisions else ""
    error = f"localisation error {number(robot.error, 2)} m"
    return f"{robot.name:<10} {robot.state.text:<21}  at {place}  waypoints {counts}  {error}{collisions}"


def simulator_line(simulator: Simulator) -> str:
    """Returns simulated time and real-time factor."""
    return f"simulator  {simulator.time:7.1f} s   real-time factor {number(simulator.real_time_factor, 2)}"


def robot_line(robot: RobotTrack) -> str:
    """Returns one robot's state, waypoint, distance to go, localisation error and collisions."""
    count = len(robot.visits)
    parts = [
        f"{robot.name:<10} {robot.state.text:<21}",
        f"waypoint {min(robot.current + 1, count)}/{count}",
        f"{number(robot.distance_to_go, 1, 5)} m to go",
        f"localisation error {number(robot.error, 2)} m",
    ]
    if robot.collisions:
        parts.append(f"collisions {robot.collisions}")
    return "  ".join(parts)


def number(value: float | None, digits: int, width: int = 0) -> str:
    """Returns a number with ``digits`` decimals; a dash for nan and None."""
    return f"{'–' if value is None or math.isnan(value) else format(value, f'.{digits}f'):>{width}}"


def fleet_status(
    fleet: Fleet, config: FleetConfig, ports: Ports, phase: str, faults: list[str], now: float
) -> dict[str, Any]:
    """Returns a fleet's status for ``json.dumps``. SI units; null for unknown.

    Args:
        fleet: its state.
        config: its configuration.
        ports: its TCP ports.
        phase: description of its current phase.
        faults: its faults, one line each.
        now: monotonic time [s].
    """
    return {
        "phase": phase,
        "faults": faults,
        "world": config.world,
        "log": str(Path.cwd() / config.log),
        "hub": f"http://127.0.0.1:{ports.hub}",
        "master": master_uri(ports.hub_gateway_master),
        "simulated_seconds": round(fleet.simulator.time, 3),
        "real_time_factor": _known(fleet.simulator.real_time_factor),
        "robots": [
            _robot(robot, port, now)
            for robot, port in zip(fleet.robots, ports.robot_masters, strict=True)
        ],
    }


def _robot(robot: RobotTrack, port: int, now: float) -> dict[str, Any]:
    return {
        "robot": robot.name,
        "master": master_uri(port),
        **robot.monitor.robot_json(now),
        **robot.state.as_json(),
        "localisation_error": _known(robot.error),
        "collisions": robot.collisions,
    }


def _known(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None
