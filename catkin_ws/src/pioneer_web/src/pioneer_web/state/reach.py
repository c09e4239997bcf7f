"""Tells where on the map a robot can go, so that a waypoint in a wall is refused at once."""

import numpy as np
from numpy.typing import NDArray

from pioneer_fleet.geometry import Pose
from pioneer_node.core.reach import PIONEER_RADIUS, areas

OCCUPIED = 65
"""Value from which a cell is occupied, as in ``map_server``'s maps."""


class Reach:
    """The places of a map that hang together, by the planner's rule. Unknown cells count as free: planners cross them.

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
            self._areas = areas(self._occupied, self._resolution)
        at = self._cell(goal)
        if at is None:
            return "it is outside the map"
        if not self._areas[at]:
            return f"a wall of the map is nearer than {PIONEER_RADIUS:g} m"
        begin = None if start is None else self._cell(start)
        # A robot whose own place counts as wall is localised badly, which says nothing about the goal.
        if begin is None or not self._areas[begin]:
            return ""
        return "" if self._areas[begin] == self._areas[at] else "on the map, no way leads there"

    def _cell(self, pose: Pose) -> tuple[int, int] | None:
        """Returns row and column of the cell at a pose; None outside the map."""
        right, up = pose.x - self._origin.x, pose.y - self._origin.y
        cos, sin = np.cos(self._origin.yaw), np.sin(self._origin.yaw)
        col = int(np.floor((cos * right + sin * up) / self._resolution))
        row = int(np.floor((cos * up - sin * right) / self._resolution))
        rows, cols = self._occupied.shape
        return (row, col) if 0 <= row < rows and 0 <= col < cols else None
