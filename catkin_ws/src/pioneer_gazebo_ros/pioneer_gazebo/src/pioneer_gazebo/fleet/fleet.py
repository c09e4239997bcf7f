"""Names and initial poses of the robots of a fleet, and whether a robot can start at a position in a map."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pioneer_gazebo.error import SimulatorError
from pioneer_node.core.fleet_file import RobotEntry

CLEARANCE = 0.2
"""Half a Pioneer's width [m]: the minimum distance of its centre from walls."""


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
        raise FleetError(
            f"{source} has no initial pose for {robot}; it has {', '.join(poses) or 'none'}"
        )
    try:
        return InitialPose(*(float(entry[key]) for key in ("x", "y", "a")))
    except (KeyError, TypeError, ValueError):
        raise FleetError(f"{source}: {robot} needs numbers x, y, a, not {dict(entry)}") from None


def pose_of_entry(
    robot: RobotEntry, number: int, poses: Mapping[str, Any], source: str
) -> InitialPose:
    """Returns the start of a fleet's robot: its own pose, or the pose of its name, or that of pioneer``number``.

    Raises:
        FleetError: none of these exists.
    """
    if robot.pose:
        return initial_pose({robot.name: robot.pose}, robot.name, "the fleet file")
    name = robot.name if robot.name in poses else f"pioneer{number}"
    return initial_pose(poses, name, source)


class PlacementError(SimulatorError):
    """A robot cannot start at its initial pose."""


@dataclass(frozen=True, slots=True)
class DrawnMap:
    """The content of a map's image."""

    #: x, y: lower left corner in ``map`` [m]
    x: float
    y: float
    resolution: float  #: side of a cell [m]
    #: rows, cols: size
    rows: int
    cols: int
    pixels: bytes  #: one byte per cell, row with the largest y first
    free: int  #: minimum value of a free cell
    occupied: int  #: maximum value of an occupied cell; values in between are unknown

    def value_at(self, row: int, col: int) -> int | None:
        """Returns the value of a cell, counted from the smallest x and y; None outside the map."""
        if not (0 <= row < self.rows and 0 <= col < self.cols):
            return None
        return self.pixels[(self.rows - 1 - row) * self.cols + col]


def check_place(drawn: DrawnMap | None, robot: str, x: float, y: float, world: str) -> None:
    """Checks that ``robot`` can start at x, y [m] in ``map``; without a map, it may start anywhere.

    Raises:
        PlacementError: the position is outside the map, too close to a wall, or in unknown space.
    """
    if drawn is None:
        return
    pose = f"{robot} cannot start at ({x:g}, {y:g}) in the world {world}"
    row, col = int((y - drawn.y) // drawn.resolution), int((x - drawn.x) // drawn.resolution)
    value = drawn.value_at(row, col)
    if value is None:
        right, top = (
            drawn.x + drawn.cols * drawn.resolution,
            drawn.y + drawn.rows * drawn.resolution,
        )
        spans = f"x from {drawn.x:g} to {right:g} and y from {drawn.y:g} to {top:g} m"
        raise PlacementError(f"{pose}: that is outside its map, which spans {spans}")
    reach = int(CLEARANCE / drawn.resolution)
    around = range(-reach, reach + 1)
    near = (
        drawn.value_at(row + up, col + right)
        for up in around
        for right in around
        if up**2 + right**2 <= reach**2
    )
    if any(cell is not None and cell <= drawn.occupied for cell in near):
        raise PlacementError(
            f"{pose}: that is inside a wall, or less than {CLEARANCE:g} m from one"
        )
    if value < drawn.free:
        raise PlacementError(f"{pose}: that is outside its walls, in unknown space")
