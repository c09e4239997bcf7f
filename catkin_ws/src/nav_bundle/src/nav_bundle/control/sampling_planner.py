"""What the two local planners that sample velocities share: following a plan, and stopping and turning at the goal."""

import math
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.base.velocity import STANDSTILL, Velocity
from nav_bundle.control.dwa_config import DwaConfig
from nav_bundle.control.local_planner import Decision, LocalPlannerError, Route, Situation
from nav_bundle.control.rollout import Rollout
from nav_bundle.control.trajectory_config import TrajectoryConfig
from nav_bundle.planning.planner import Path

Config = TypeVar("Config", DwaConfig, TrajectoryConfig)


class SamplingPlanner(Generic[Config]):
    """Follows a plan by the best of the sampled velocities until the robot is within ``xy_goal_tolerance`` of the goal.

    There it stops, rotates to the goal's heading and stops again, as base_local_planner does.

    Args:
        config: the planner's parameters.
        rollout: scores the samples.
        slowest: slowest turn [rad/s] that the robot can execute.
        right: fastest turn to the right [rad/s], positive.
        still: at or below these speeds [m/s], [rad/s] the robot counts as stopped.
    """

    _no_command: str  #: the reason if no sample is valid

    def __init__(
        self,
        config: Config,
        rollout: Rollout,
        slowest: float,
        right: float,
        still: tuple[float, float],
    ) -> None:
        self.config: Config = config
        self._rollout = rollout
        self._slowest, self._right, self._still = slowest, right, still
        self._period = 1.0 / config.controller_frequency
        self._route: Route | None = None
        self._restart()

    def _restart(self) -> None:
        """Forgets what was reached on the way to the last goal."""
        self._latched = self._rotating = False

    def set_plan(self, plan: Path) -> None:
        """Sets a new plan; the goal approach restarts only if the plan leads to another goal."""
        route = Route(plan)
        if self._route is None or self._route.goal != route.goal:
            self._restart()
        self._route = route

    def cell_costs(self) -> NDArray[np.float64]:
        """Returns the costs of the local costmap's cells; see ``Rollout.cell_costs``."""
        return self._rollout.cell_costs()

    def decide(self, situation: Situation) -> Decision:
        """Returns the command for this cycle; see ``local_planner.LocalPlanner``."""
        if self._route is None:
            raise LocalPlannerError("there is no plan to follow")
        ahead = self._route.ahead(situation, self.config.prune_plan)
        goal = situation.local_from_global.compose(self._route.goal)
        if not self._begin(situation, ahead):
            raise LocalPlannerError("the global plan does not cross the local costmap")
        if self._is_near(situation.pose, goal):
            return self._approach(situation, goal)
        best = self._best(situation, ahead)
        if best is None:
            raise LocalPlannerError(self._no_command)
        return Decision(best[0], False, self._rollout.poses(*best), ahead)

    def _begin(self, situation: Situation, ahead: NDArray[np.float64]) -> bool:
        """Starts a cycle with the plan's part ``ahead``; returns whether it crosses the local costmap."""
        return self._rollout.begin(situation, ahead)

    def _best(
        self, situation: Situation, ahead: NDArray[np.float64]
    ) -> tuple[Velocity, float] | None:
        """Returns the best velocity and how long [s] it is known to be collision-free (inf: the whole horizon)."""
        raise NotImplementedError

    def _is_near(self, pose: Pose, goal: Pose) -> bool:
        """Returns whether the goal position is reached; ``latch_xy_goal_tolerance`` latches the result."""
        near = pose.distance(goal) <= self.config.xy_goal_tolerance
        if near and self.config.latch_xy_goal_tolerance:
            self._latched = True
        if not (near or self._latched):
            self._rotating = False
        return near or self._latched

    def _approach(self, situation: Situation, goal: Pose) -> Decision:
        """Returns the command that stops the robot and turns it to the heading of ``goal``.

        Raises:
            LocalPlannerError: the turn would hit an obstacle.
        """
        velocity, difference = situation.velocity, angle_difference(goal.yaw, situation.pose.yaw)
        if abs(difference) <= self.config.yaw_goal_tolerance:
            self._latched = self._rotating = False
            return Decision(STANDSTILL, True)
        stopped = (
            math.hypot(velocity.x, velocity.y) <= self._still[0]
            and abs(velocity.turn) <= self._still[1]
        )
        if not (self._rotating or stopped):
            slowed = self._slowed(velocity)
            return Decision(slowed if self._rollout.is_free(slowed) else STANDSTILL)
        self._rotating = True
        turn = Velocity(turn=self._turning_speed(difference, velocity.turn))
        if not self._rollout.is_free(turn):
            raise LocalPlannerError("Error when rotating.")
        return Decision(turn)

    def _slowed(self, velocity: Velocity) -> Velocity:
        """Returns the velocity after one period of braking."""
        config, period = self.config, self._period
        return Velocity(
            _towards_zero(velocity.x, config.acc_lim_x * period),
            _towards_zero(velocity.y, config.acc_lim_y * period),
            _towards_zero(velocity.turn, config.acc_lim_theta * period),
        )

    def _turning_speed(self, difference: float, current: float) -> float:
        """Returns a turning speed for ``difference`` [rad]: reachable, able to stop in time, not below the slowest."""
        fastest = self.config.max_vel_theta if difference > 0.0 else self._right
        speed = min(max(abs(difference), self._slowest), fastest)
        change = self.config.acc_lim_theta * self._period
        speed = min(max(speed, abs(current) - change), abs(current) + change)
        speed = min(speed, math.sqrt(2.0 * self.config.acc_lim_theta * abs(difference)))
        return math.copysign(min(max(speed, self._slowest), fastest), difference)


def _towards_zero(value: float, change: float) -> float:
    return math.copysign(max(0.0, abs(value) - change), value)
