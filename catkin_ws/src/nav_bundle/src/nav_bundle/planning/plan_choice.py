"""Which plan the robot follows, and what is known of the obstacles that blocked plans for its goal."""

import math

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.cost import INSCRIBED
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.planning.followed_plan import FollowedPlan, cost_of
from nav_bundle.planning.navfn import NavfnSearch
from nav_bundle.planning.planner import Path, Search

_SAME_PLACE = 1.0
"""Plans that are blocked less than this distance [m] apart are blocked by the same obstacle."""
_BLOCKED_NEAR = 1.5
"""A robot without another plan stops at this distance [m] from the place where its plan is blocked."""
_SURELY_FREE = 3.0
"""A place where a plan was blocked counts as passable after this time [s] without an obstacle."""
_BETTER = 0.9
"""A plan that leads another way replaces the current one if its cost is below this share of the current one's."""


class PlanChoice:
    """The plan that is followed to one goal, and the places where plans to that goal were blocked."""

    def __init__(self) -> None:
        self.followed: FollowedPlan | None = None  #: the current plan; None before the first one
        self.blocked_at: tuple[float, float] | None = (
            None  #: where the current plan is blocked (x, y) [m]
        )
        self._found_blocked: dict[
            tuple[float, float], float
        ] = {}  # when each place was last seen blocked [s]
        self._cleared: list[
            NDArray[np.float64]
        ] = []  # obstacles known before each recovery behaviour (n, 2) [m]
        self._discovered = False

    @property
    def last_blocked(self) -> tuple[float, float] | None:
        """Where the current plan is blocked, or else a plan was last seen blocked; None if none ever was."""
        if self.blocked_at is not None:
            return self.blocked_at
        if not self._found_blocked:
            return None
        return max(self._found_blocked, key=lambda place: self._found_blocked[place])

    def check(self, costmap: Costmap, pose: Pose | None, now: float) -> None:
        """Finds the first place ahead where the plan is blocked; call it after each update of the costmap."""
        if self.followed is None or pose is None:
            self.blocked_at = None
            return
        for known in self._found_blocked:
            if costmap.cost_of_cell(*known) >= INSCRIBED:
                self._found_blocked[known] = now
        self.blocked_at = place = self.followed.blocked_at(costmap, pose)
        if place is not None:
            self._discovered |= not self._is_known(place)
            self._found_blocked[place] = now

    def take_discovery(self) -> bool:
        """Returns whether an obstacle that was not known before was found on the way since the last call."""
        discovered = self._discovered
        self._discovered = False
        return discovered

    def note_cleared(self, obstacles: NDArray[np.float64]) -> None:
        """Records the obstacles (n, 2) [m] that a recovery behaviour may clear: found again, they are not new."""
        self._cleared.append(obstacles)

    def _is_known(self, place: tuple[float, float]) -> bool:
        """Returns whether the obstacle at ``place`` was found for this goal before, maybe cleared by a recovery."""
        if any(math.dist(place, known) < _SAME_PLACE for known in self._found_blocked):
            return True
        return any(
            np.hypot(*(points - place).T).min(initial=np.inf) < _SAME_PLACE
            for points in self._cleared
        )

    def remaining(self, pose: Pose | None) -> float | None:
        """Returns the remaining way by the plan [m]; None without a plan, or if it is blocked."""
        if pose is None or self.followed is None:
            return None
        remaining = self.followed.pass_by(pose)
        return remaining if self.blocked_at is None else None

    def is_blocked_near(self, pose: Pose | None) -> bool:
        """Returns whether the plan is blocked so near that driving on leads nowhere."""
        place = self.blocked_at
        return (
            place is not None
            and pose is not None
            and math.dist(place, (pose.x, pose.y)) < _BLOCKED_NEAR
        )

    def takes(self, path: Path, search: Search | None, now: float) -> bool:
        """Follows the new plan ``path`` from now on, if it is better; returns whether it is."""
        if self.followed is not None and not self._is_better(path, self.followed, search, now):
            return False
        self.followed = FollowedPlan(path)
        self.blocked_at = None
        return True

    def _is_better(
        self, path: Path, followed: FollowedPlan, search: Search | None, now: float
    ) -> bool:
        """Returns whether a new plan replaces the one that is followed.

        It does not where both lead different ways at nearly the same cost, or where it leads past a place that was
        blocked a moment ago: a robot that changes its mind halfway arrives nowhere.
        """
        if self.blocked_at is not None or followed.is_astray or followed.leads_as(path):
            return True
        if not isinstance(search, NavfnSearch) or not np.array_equal(path[-1], followed.path[-1]):
            return True
        doubtful = [
            place for place, time in self._found_blocked.items() if now - time < _SURELY_FREE
        ]
        if any(np.hypot(path[:, 0] - x, path[:, 1] - y).min() < _SAME_PLACE for x, y in doubtful):
            return False
        current_cost = cost_of(followed.ahead, search.costs, search.geometry, search.weights)
        return cost_of(path, search.costs, search.geometry, search.weights) < _BETTER * current_cost
