"""The global plan that the robot follows: what is left of it, what blocks it, and whether another one is better."""

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.cost import INSCRIBED, UNKNOWN
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.geometry import Geometry
from nav_bundle.planning.planner import Path

_SEARCHED = 3.0
"""Length of the plan [m] in which the robot's place on it is searched, from its last place on."""
_NEAR = 0.5
"""A plan that stays within this distance [m] of the followed one leads the same way."""
_ASTRAY = 1.0
"""A robot farther than this [m] from its plan does not follow it."""


class FollowedPlan:
    """A plan and the robot's place on it.

    Args:
        path: the plan, in the global costmap's frame.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        steps = np.hypot(np.diff(path[:, 0]), np.diff(path[:, 1]))
        self._left = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
        self._at = 0
        self._away = 0.0

    def pass_by(self, pose: Pose) -> float:
        """Updates the robot's place on the plan; returns the remaining way from there [m]."""
        last = int(np.searchsorted(-self._left, _SEARCHED - self._left[self._at], side="right"))
        part = self.path[self._at : max(last, self._at + 1)]
        away = np.hypot(part[:, 0] - pose.x, part[:, 1] - pose.y)
        nearest = int(away.argmin())
        self._at += nearest
        self._away = float(away[nearest])
        return float(self._left[self._at]) + self._away

    @property
    def ahead(self) -> Path:
        """The part of the plan from the robot's place on."""
        return self.path[self._at :]

    @property
    def is_astray(self) -> bool:
        """Whether the robot was last too far from the plan to be following it."""
        return self._away > _ASTRAY

    def leads_as(self, path: Path) -> bool:
        """Returns whether ``path`` stays near this plan, or goes where this plan has been."""
        own = self.path[max(self._at - 1, 0) :: 2, :2]
        other = path[::4, :2]
        for first in range(0, len(other), 64):
            part = other[first : first + 64]
            gaps = np.hypot(*(part[:, None, :] - own[None, :, :]).transpose(2, 0, 1))
            if gaps.min(axis=1).max() > _NEAR:
                return False
        return True

    def blocked_at(self, costmap: Costmap, pose: Pose) -> tuple[float, float] | None:
        """Returns the first place ahead (x, y) [m] where the robot does not fit; None if there is none.

        Cells around the robot and the goal itself do not count: the planner opens the former, and its tolerance covers
        the latter.
        """
        ahead = self.ahead
        costs = _costs_at(costmap.cells, costmap.geometry, ahead)
        blocked = (costs >= INSCRIBED) & (costs != UNKNOWN)
        own = (
            np.hypot(ahead[:, 0] - pose.x, ahead[:, 1] - pose.y)
            < costmap.footprint.inscribed_radius
        )
        blocked &= ~own
        if not blocked.any():
            return None
        x, y = ahead[int(blocked.argmax()), :2]
        return float(x), float(y)


def cost_of(
    path: Path, costs: NDArray[np.uint8], place: Geometry, weights: NDArray[np.float32]
) -> float:
    """Returns the cost of following ``path`` as the planner counts it; infinite if it is blocked.

    Args:
        path: poses (n, 3).
        costs: costs of the cells, uint8, shape (rows, cols).
        place: geometry of the cells.
        weights: potential added by crossing a cell of each cost, negative if blocked, shape (256,).
    """
    if len(path) < 2:
        return 0.0
    crossed = weights[_costs_at(costs, place, path)]
    steps = np.hypot(np.diff(path[:, 0]), np.diff(path[:, 1])) / place.resolution
    crossed = np.where(crossed < 0.0, np.inf, crossed)[:-1]
    return float((crossed * steps)[steps > 0.0].sum())


def _costs_at(costs: NDArray[np.uint8], place: Geometry, path: Path) -> NDArray[np.uint8]:
    """Returns the costs of the cells that the path's poses lie in, shape (n,); unknown outside the grid."""
    cols = np.floor((path[:, 0] - place.origin_x) / place.resolution).astype(np.int64)
    rows = np.floor((path[:, 1] - place.origin_y) / place.resolution).astype(np.int64)
    inside = (rows >= 0) & (rows < costs.shape[0]) & (cols >= 0) & (cols < costs.shape[1])
    found = np.full(len(path), UNKNOWN, np.uint8)
    found[inside] = costs[rows[inside], cols[inside]]
    return found
