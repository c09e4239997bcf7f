"""What a global planner is: values in, a path out, or an error that says why not."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core.costmap.costmap import Costmap
from nav_bundle.core.error import NavigationError
from nav_bundle.core.pose import Pose

Path = NDArray[np.float64]
"""Poses (x, y [m], yaw [rad]), shape (n, 3), from the robot to the goal, in the global costmap's frame."""


class PlannerError(NavigationError):
    """There is no path, and why."""


class StartOutsideError(PlannerError):
    """The robot is not on the costmap."""


class GoalOutsideError(PlannerError):
    """The goal is not on the costmap."""


class NoPathError(PlannerError):
    """Nothing within the tolerance of the goal can be reached."""


class Search(Protocol):
    """A search under way, on a picture of the costmap taken at its start."""

    def advance(self, budget: int) -> Path | None:
        """Looks at about ``budget`` more cells; returns the path once it is found.

        Raises:
            NoPathError: the goal cannot be reached.
        """
        ...


class GlobalPlanner(Protocol):
    """Plans over a global costmap."""

    def search(self, costmap: Costmap, start: Pose, goal: Pose, tolerance: float | None = None) -> Search:
        """Begins the search for a path; ``tolerance`` [m] around the goal, the planner's own where None.

        Raises:
            StartOutsideError: the robot is not on the costmap.
            GoalOutsideError: the goal is not on the costmap.
        """
        ...


EVERYTHING = 1 << 62
"""A budget that lets a search end in one call."""


def path_between(
    planner: GlobalPlanner, costmap: Costmap, start: Pose, goal: Pose, tolerance: float | None = None
) -> Path:
    """Returns the whole path in one call.

    Raises:
        PlannerError: there is none.
    """
    path = planner.search(costmap, start, goal, tolerance).advance(EVERYTHING)
    if path is None:
        raise NoPathError("Failed to get a plan.")
    return path
