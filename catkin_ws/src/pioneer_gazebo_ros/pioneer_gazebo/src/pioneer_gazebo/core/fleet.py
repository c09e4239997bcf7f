"""Names and initial poses of the robots of a fleet."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pioneer_gazebo.core.error import SimulatorError
from pioneer_node.core.fleet_file import RobotEntry


class FleetError(SimulatorError):
    """A robot has no valid name or initial pose."""


@dataclass(frozen=True, slots=True)
class InitialPose:
    """A robot's start in the map: x, y [m] and heading a [rad]."""

    x: float
    y: float
    a: float


def robot_names(count: int) -> tuple[str, ...]:
    """Returns ``pioneer1`` … ``pioneerN``.

    Raises:
        FleetError: the count is below 1.
    """
    if count < 1:
        raise FleetError(f"there must be 1 robot or more, not {count}")
    return tuple(f"pioneer{number}" for number in range(1, count + 1))


def robot_of_host(host: str) -> str | None:
    """Returns the robot of a computer, ``pioneerX`` for ``aadiX``; None for other host names."""
    match = re.fullmatch(r"aadi(\d+)", host.split(".")[0])
    return f"pioneer{int(match[1])}" if match else None


def initial_pose(poses: Mapping[str, Any], robot: str, source: str) -> InitialPose:
    """Returns a robot's initial pose from the content of a poses file.

    Raises:
        FleetError: the robot is not in it, or its entry is incomplete; ``source`` names the file.
    """
    entry = poses.get(robot)
    if not isinstance(entry, Mapping):
        raise FleetError(f"{source} has no initial pose for {robot}; it has {', '.join(poses) or 'none'}")
    try:
        return InitialPose(*(float(entry[key]) for key in ("x", "y", "a")))
    except (KeyError, TypeError, ValueError):
        raise FleetError(f"{source}: {robot} needs numbers x, y, a, not {dict(entry)}") from None


def pose_of_entry(robot: RobotEntry, number: int, poses: Mapping[str, Any], source: str) -> InitialPose:
    """Returns the start of a fleet's robot: its own pose, or the pose of its name, or that of pioneer``number``.

    Raises:
        FleetError: none of these exists.
    """
    if robot.pose:
        return initial_pose({robot.name: robot.pose}, robot.name, "the fleet file")
    name = robot.name if robot.name in poses else f"pioneer{number}"
    return initial_pose(poses, name, source)
