"""The end of the way: stop, turn to the goal's heading, stop again."""

import math
from collections.abc import Callable

from nav_bundle.core.local_planner import STANDSTILL, Decision, LocalPlannerError, Situation, Velocity
from nav_bundle.core.pose import Pose, angle_difference
from nav_bundle.core.trajectory_config import TrajectoryConfig


class GoalApproach:
    """What base_local_planner does within ``xy_goal_tolerance`` of the goal."""

    def __init__(self, config: TrajectoryConfig) -> None:
        self._config = config
        self._period = 1.0 / config.controller_frequency
        self.reset()

    def reset(self) -> None:
        """Forgets that the goal's place was reached."""
        self._latched = False
        self._rotating = False

    def is_near(self, pose: Pose, goal: Pose) -> bool:
        """Tells whether the goal's place is reached; for good, with ``latch_xy_goal_tolerance``."""
        near = pose.distance(goal) <= self._config.xy_goal_tolerance
        if near and self._config.latch_xy_goal_tolerance:
            self._latched = True
        if not (near or self._latched):
            self._rotating = False
        return near or self._latched

    def decide(self, situation: Situation, goal: Pose, is_free: Callable[[Velocity], bool]) -> Decision:
        """Returns the command that ends at ``goal``'s heading.

        Raises:
            LocalPlannerError: an obstacle is in the way of the turn.
        """
        difference = angle_difference(goal.yaw, situation.pose.yaw)
        if abs(difference) <= self._config.yaw_goal_tolerance:
            self.reset()
            return Decision(STANDSTILL, True)
        if not self._rotating and not self._is_stopped(situation.velocity):
            return Decision(self._slowed(situation.velocity, is_free))
        self._rotating = True
        turn = Velocity(turn=self._turning_speed(difference, situation.velocity.turn))
        if not is_free(turn):
            raise LocalPlannerError("Error when rotating.")
        return Decision(turn)

    def _is_stopped(self, velocity: Velocity) -> bool:
        standing = math.hypot(velocity.x, velocity.y) <= self._config.trans_stopped_velocity
        return standing and abs(velocity.turn) <= self._config.rot_stopped_velocity

    def _slowed(self, velocity: Velocity, is_free: Callable[[Velocity], bool]) -> Velocity:
        """Returns the velocity after one period of braking; standstill if even that meets an obstacle."""
        config, period = self._config, self._period
        slowed = Velocity(
            _towards_zero(velocity.x, config.acc_lim_x * period),
            _towards_zero(velocity.y, config.acc_lim_y * period),
            _towards_zero(velocity.turn, config.acc_lim_theta * period),
        )
        return slowed if is_free(slowed) else STANDSTILL

    def _turning_speed(self, difference: float, current: float) -> float:
        """Returns a speed that turns by ``difference`` [rad]: reachable, able to stop in time, not too slow to move."""
        config = self._config
        fastest = config.max_vel_theta if difference > 0.0 else -config.min_vel_theta
        speed = min(max(abs(difference), config.min_in_place_vel_theta), fastest)
        change = config.acc_lim_theta * self._period
        speed = min(max(speed, abs(current) - change), abs(current) + change)
        speed = min(speed, math.sqrt(2.0 * config.acc_lim_theta * abs(difference)))
        return math.copysign(min(max(speed, config.min_in_place_vel_theta), fastest), difference)


def _towards_zero(value: float, change: float) -> float:
    return math.copysign(max(0.0, abs(value) - change), value)
