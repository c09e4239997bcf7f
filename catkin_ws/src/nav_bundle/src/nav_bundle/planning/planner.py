"""The global planner interface: searches a path on a costmap, or raises an error with the reason."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.error import NavigationError
from nav_bundle.base.pose import Pose
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.geometry import Geometry

Path = NDArray[np.float64]
"""Poses (x, y [m], yaw [rad]), shape (n, 3), from the robot to the goal, in the global costmap's frame."""


class PlannerError(NavigationError):
    """There is no path; the message names the reason."""


class StartOutsideError(PlannerError):
    """The robot is not on the costmap."""


class GoalOutsideError(PlannerError):
    """The goal is not on the costmap."""


class NoPathError(PlannerError):
    """No cell within the tolerance of the goal can be reached."""


class Search(Protocol):
    """An incremental search on a snapshot of the costmap."""

    def advance(self, budget: int) -> Path | None:
        """Visits about ``budget`` more cells; returns the path once it is found.

        Raises:
            NoPathError: the goal cannot be reached.
        """
        ...


class GlobalPlanner(Protocol):
    """Plans paths on a global costmap."""

    def search(
        self, costmap: Costmap, start: Pose, goal: Pose, tolerance: float | None = None
    ) -> Search:
        """Starts a search for a path; ``tolerance`` [m] applies around the goal (None: the planner's default).

        Raises:
            StartOutsideError: the robot is not on the costmap.
            GoalOutsideError: the goal is not on the costmap.
        """
        ...


def nearest_inside(place: Geometry, goal: Pose, tolerance: float) -> Pose:
    """Returns the nearest pose to ``goal`` on the costmap; ``goal`` if that is more than ``tolerance`` [m] away."""
    margin = place.resolution / 2.0
    right = place.origin_x + place.cols * place.resolution
    top = place.origin_y + place.rows * place.resolution
    if place.contains(place.cell_at(goal.x, goal.y)):
        return goal
    x = min(max(goal.x, place.origin_x + margin), right - margin)
    y = min(max(goal.y, place.origin_y + margin), top - margin)
    inside = Pose(x, y, goal.yaw)
    return inside if inside.distance(goal) <= tolerance else goal


def with_goal(path: Path, goal: Pose, resolution: float) -> Path:
    """Returns ``path``, with ``goal`` appended if the path ends more than a cell of ``resolution`` [m] beside it."""
    end = Pose(float(path[-1, 0]), float(path[-1, 1]))
    if end.distance(goal) <= resolution:
        return path
    return np.vstack([path, [goal.x, goal.y, goal.yaw]])


EVERYTHING = 1 << 62
"""A budget with which every search ends in one call."""


def path_between(
    planner: GlobalPlanner,
    costmap: Costmap,
    start: Pose,
    goal: Pose,
    tolerance: float | None = None,
) -> Path:
    """Returns the path, searched in one call.

    Raises:
        PlannerError: there is no path.
    """
    path = planner.search(costmap, start, goal, tolerance).advance(EVERYTHING)
    if path is None:
        raise NoPathError("Failed to get a plan.")
    return path
