"""The global planner interface: searches a path on a costmap, or raises an error with the reason."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.error import NavigationError
from nav_bundle.base.pose import Pose
from nav_bundle.costmap.costmap import Costmap

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
