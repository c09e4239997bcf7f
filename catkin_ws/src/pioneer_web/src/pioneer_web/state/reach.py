"""Tells where on the map a robot can go, so that a waypoint in a wall is refused at once."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pioneer_fleet.geometry import Pose

CLEARANCE = 0.2
"""Minimum distance of a robot's centre from an occupied cell [m]: half a Pioneer's width."""
OCCUPIED = 65
"""Value from which a cell is occupied, as in ``map_server``'s maps."""


class Reach:
    """The places of a map that hang together. Unknown cells count as free: planners cross them.

    Args:
        cells: [row, col] of a ``nav_msgs/OccupancyGrid``, row 0 at the bottom.
        resolution: size of a cell [m].
        origin: pose of the lower left corner in ``map``.
    """

    def __init__(self, cells: NDArray[np.int8], resolution: float, origin: Pose) -> None:
        self._resolution = resolution
        self._origin = origin
        self._occupied = cells >= OCCUPIED
        #: number of the connected area of each cell, 0 where no robot can be; made when it is first asked for
        self._areas: NDArray[np.int32] | None = None

    def refusal(self, start: Pose | None, goal: Pose) -> str:
        """Returns why a robot at ``start`` (None if unknown) cannot drive to ``goal``; empty if it can."""
        if self._areas is None:
            self._areas = self._connected()
        at = self._cell(goal)
        if at is None:
            return "it is outside the map"
        if not self._areas[at]:
            return f"a wall of the map is nearer than {CLEARANCE:g} m"
        begin = None if start is None else self._cell(start)
        # A robot whose own place counts as wall is localised badly, which says nothing about the goal.
        if begin is None or not self._areas[begin]:
            return ""
        return "" if self._areas[begin] == self._areas[at] else "on the map, no way leads there"

    def _connected(self) -> NDArray[np.int32]:
        radius = int(CLEARANCE / self._resolution)
        row, col = np.ogrid[-radius : radius + 1, -radius : radius + 1]
        disk = row**2 + col**2 <= radius**2
        too_near = ndimage.binary_dilation(self._occupied, disk)
        areas: NDArray[np.int32] = ndimage.label(~too_near, np.ones((3, 3)), output=np.int32)[0]
        return areas

    def _cell(self, pose: Pose) -> tuple[int, int] | None:
        """Returns row and column of the cell at a pose; None outside the map."""
        right, up = pose.x - self._origin.x, pose.y - self._origin.y
        cos, sin = np.cos(self._origin.yaw), np.sin(self._origin.yaw)
        col = int(np.floor((cos * right + sin * up) / self._resolution))
        row = int(np.floor((cos * up - sin * right) / self._resolution))
        rows, cols = self._occupied.shape
        return (row, col) if 0 <= row < rows and 0 <= col < cols else None
