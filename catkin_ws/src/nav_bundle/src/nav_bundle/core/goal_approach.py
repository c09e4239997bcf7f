"""Goal approach: stop, rotate to the goal's heading, stop again."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from nav_bundle.core.local_planner import STANDSTILL, Decision, LocalPlannerError, Situation, Velocity
from nav_bundle.core.pose import Pose, angle_difference


@dataclass(frozen=True)
class ApproachConfig:
    """A local planner's parameters for the goal approach."""

    acc: Velocity  #: acceleration limits [m/s**2, rad/s**2]
    #: left, right: fastest turns [rad/s], both positive
    left: float
    right: float
    slowest: float  #: slowest turn [rad/s] that the robot can execute
    #: place, heading: goal tolerances [m], [rad]
    place: float
    heading: float
    latch: bool  #: once reached, the goal position stays reached
    #: still, still_turning: at or below these speeds [m/s], [rad/s] the robot counts as stopped
    still: float
    still_turning: float
    period: float  #: control period [s]


class GoalApproach:
    """Controls the robot within ``xy_goal_tolerance`` of the goal, as base_local_planner does."""

    def __init__(self, config: ApproachConfig) -> None:
        self._config = config
        self._latched = self._rotating = False

    def reset(self) -> None:
        """Forgets that the goal position was reached."""
        self._latched = self._rotating = False

    def is_near(self, pose: Pose, goal: Pose) -> bool:
        """Returns whether the goal position is reached; ``latch_xy_goal_tolerance`` latches the result."""
        near = pose.distance(goal) <= self._config.place
        if near and self._config.latch:
            self._latched = True
        if not (near or self._latched):
            self._rotating = False
        return near or self._latched

    def decide(self, situation: Situation, goal: Pose, is_free: Callable[[Velocity], bool]) -> Decision:
        """Returns the command that stops the robot and turns it to the heading of ``goal``.

        Raises:
            LocalPlannerError: the turn would hit an obstacle.
        """
        difference = angle_difference(goal.yaw, situation.pose.yaw)
        if abs(difference) <= self._config.heading:
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
        standing = math.hypot(velocity.x, velocity.y) <= self._config.still
        return standing and abs(velocity.turn) <= self._config.still_turning

    def _slowed(self, velocity: Velocity, is_free: Callable[[Velocity], bool]) -> Velocity:
        """Returns the velocity after one period of braking; standstill if that velocity would hit an obstacle."""
        config, period = self._config, self._config.period
        slowed = Velocity(
            _towards_zero(velocity.x, config.acc.x * period),
            _towards_zero(velocity.y, config.acc.y * period),
            _towards_zero(velocity.turn, config.acc.turn * period),
        )
        return slowed if is_free(slowed) else STANDSTILL

    def _turning_speed(self, difference: float, current: float) -> float:
        """Returns a turning speed for ``difference`` [rad]: reachable, able to stop in time, not below ``slowest``."""
        config = self._config
        fastest = config.left if difference > 0.0 else config.right
        speed = min(max(abs(difference), config.slowest), fastest)
        change = config.acc.turn * config.period
        speed = min(max(speed, abs(current) - change), abs(current) + change)
        speed = min(speed, math.sqrt(2.0 * config.acc.turn * abs(difference)))
        return math.copysign(min(max(speed, config.slowest), fastest), difference)


def _towards_zero(value: float, change: float) -> float:
    return math.copysign(max(0.0, abs(value) - change), value)
