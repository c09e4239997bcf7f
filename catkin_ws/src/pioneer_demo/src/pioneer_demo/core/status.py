"""Status of a fleet on this machine, for ``./pioneer status``."""

import math
from pathlib import Path
from typing import Any

from pioneer_demo.core.command import Ports, master_uri
from pioneer_demo.core.fleet import Fleet
from pioneer_demo.core.option import FleetConfig
from pioneer_demo.core.track import RobotTrack
from pioneer_demo.core.view import state_word


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
    masters = zip((robot.name for robot in fleet.robots), ports.robot_masters, strict=True)
    return {
        "phase": phase,
        "faults": faults,
        "world": config.world,
        "log": str(Path.cwd() / config.log),
        "hub": f"http://127.0.0.1:{ports.hub}",
        "master": master_uri(ports.hub_gateway_master),
        "simulated_seconds": round(fleet.simulator.time, 3),
        "real_time_factor": _known(fleet.simulator.real_time_factor),
        "robots": [_robot(robot, port, now) for robot, (_, port) in zip(fleet.robots, masters, strict=True)],
    }


def _robot(robot: RobotTrack, port: int, now: float) -> dict[str, Any]:
    return {
        "robot": robot.name,
        "master": master_uri(port),
        "state": state_word(robot),
        **robot.monitor.robot_json(now),
        "localisation_error": _known(robot.error),
        "collisions": robot.collisions,
    }


def _known(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 3)
