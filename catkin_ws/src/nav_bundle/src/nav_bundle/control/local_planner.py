"""The local planner interface, and the handling of the global plan that all local planners share."""

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.error import NavigationError
from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import STANDSTILL, Velocity
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.planning.planner import Path

_BEHIND = 1.0
"""Plan points before the first one within this distance [m] of the robot are pruned, as in base_local_planner."""


class LocalPlannerError(NavigationError):
    """No valid velocity was found; the message names the reason."""


@dataclass(frozen=True, eq=False)
class Situation:
    """A local planner's input for one cycle."""

    costmap: Costmap  #: the local costmap
    pose: Pose  #: the robot's pose in the local costmap's frame
    velocity: Velocity  #: the robot's measured velocity
    local_from_global: Pose  #: pose of the global plan's frame in the local costmap's frame
    fastest: float = math.inf  #: speed limit [m/s] in front of unmapped obstacles


@dataclass(frozen=True, eq=False)
class Decision:
    """A local planner's output for one cycle."""

    velocity: Velocity = STANDSTILL  #: the command
    reached: bool = False  #: the goal is reached; the command is standstill
    #: poses (n, 3) along the commanded trajectory, in the local frame; empty if there is none
    local_plan: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    #: the part of the plan (n, 3) in the local costmap, in the local frame
    global_plan: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))


class LocalPlanner(Protocol):
    """Computes velocities that follow a global plan, one per cycle."""

    def set_plan(self, plan: Path) -> None:
        """Sets a new plan, in the global frame, and starts to follow it."""
        ...

    def decide(self, situation: Situation) -> Decision:
        """Returns the command for this cycle.

        Raises:
            LocalPlannerError: there is no valid velocity.
        """
        ...

    def cell_costs(self) -> NDArray[np.float64]:
        """Returns the costs of the local costmap's cells (n, 6); see ``Rollout.cell_costs``."""
        ...


class Route:
    """The global plan being followed, and its part ahead within the local costmap."""

    def __init__(self, plan: Path) -> None:
        self.plan = plan
        self._first = 0

    @property
    def goal(self) -> Pose:
        """The plan's last pose, in the plan's frame."""
        x, y, yaw = (float(value) for value in self.plan[-1])
        return Pose(x, y, yaw)

    def ahead(self, situation: Situation, prune: bool) -> NDArray[np.float64]:
        """Returns the plan's poses (n, 3) in the local frame: the first consecutive run within the costmap's reach.

        Yaw is not normalised. ``prune`` permanently removes the poses behind the robot.

        Raises:
            LocalPlannerError: no pose of the plan is within reach.
        """
        place = situation.costmap.geometry
        reach = max(place.rows, place.cols) * place.resolution / 2.0
        robot = situation.local_from_global.inverse().compose(situation.pose)
        distance = np.hypot(
            self.plan[self._first :, 0] - robot.x, self.plan[self._first :, 1] - robot.y
        )
        near = distance <= reach
        if not near.any():
            raise LocalPlannerError(
                "Received plan with zero length: the global plan does not pass the robot"
            )
        begin = int(near.argmax())
        end = begin + (len(near) - begin if near[begin:].all() else int(near[begin:].argmin()))
        behind = distance[begin:end] < _BEHIND
        if prune and behind.any():
            begin += int(behind.argmax())
        x, y, yaw = self.plan[self._first + begin : self._first + end].T
        if prune:
            self._first += begin
        transform = situation.local_from_global
        return np.column_stack([*transform.apply(x, y), yaw + transform.yaw])
