"""Turns a robot in place if it has a goal but move_base has not moved it for a while."""

import math
from dataclasses import dataclass
from typing import Any

from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from geometry_msgs.msg import Twist, Vector3
from std_msgs.msg import String

from pioneer_node.adapters.node_handle import NodeHandle
from pioneer_node.core.parameter import ParameterError, config_from_mapping
from pioneer_node.nodes.node_host import run
from simple_navigation_goals.spin import PATIENCE, SpinState, blinded, commanded, watched

_MAX_VEL_THETA = "move_base/TrajectoryPlannerROS/max_vel_theta"


@dataclass(frozen=True)
class RecoverConfig:
    """``cmd_vel_topic``: topic of move_base's commands and of the recovery's own commands."""

    cmd_vel_topic: str = "cmd_vel"


class SpinRecoverNode:
    """Monitors move_base and its commands; a robot that stands for 5 s with a goal turns in place for 1.5 s.

    Subscribes:
        move_base/status (actionlib_msgs/GoalStatusArray): whether a goal is active; also drives this node's timing.
        <cmd_vel_topic> (geometry_msgs/Twist): move_base's commands.
        move_base/safety_stop (std_msgs/String): why move_base stops the robot; empty while it does not. There is no
        turn meanwhile. A C++ move_base has no such topic.

    Publishes:
        <cmd_vel_topic> (geometry_msgs/Twist): the turn, repeated with each status and after each command from
        move_base, so that it overrides them; one zero velocity at its end.

    Parameters: ``RecoverConfig``; move_base/TrajectoryPlannerROS/max_vel_theta [rad/s], read at start and whenever it
    is set; 1.0 if it is not set.

    All times are ROS times; nothing polls.

    On error: a max_vel_theta that is not a positive number ends the node with one line at start. At run time it is
    logged, and the last valid value stays in use.
    """

    def __init__(self, node: NodeHandle) -> None:
        self._node = node
        config = config_from_mapping(RecoverConfig, node.parameters(), node.name)
        self._limit = node.resolved(_MAX_VEL_THETA)
        self._speed = self._checked(node.parameter(_MAX_VEL_THETA, None))
        self._state = SpinState()
        node.watch(_MAX_VEL_THETA, self._reload)
        self._publisher = node.advertise(config.cmd_vel_topic, Twist)
        node.subscribe("move_base/status", GoalStatusArray, self._on_status)
        node.subscribe(config.cmd_vel_topic, Twist, self._on_command)
        node.subscribe("move_base/safety_stop", String, self._on_safety_stop)

    def _checked(self, limit: Any) -> float:
        limit = 1.0 if limit is None else limit
        if (
            isinstance(limit, bool)
            or not isinstance(limit, int | float)
            or not 0.0 < limit < math.inf
        ):
            raise ParameterError(
                f"parameter {self._limit} must be a positive number, not {limit!r}"
            )
        return float(limit)

    def _reload(self, limit: Any) -> None:
        try:
            self._speed = self._checked(limit)
        except ParameterError as error:
            self._node.logger.error("%s", error)

    def _on_status(self, message: GoalStatusArray, _sender: str) -> None:
        active = any(status.status == GoalStatus.ACTIVE for status in message.status_list)
        self._enter(watched(self._state, active, self._node.now()))

    def _on_command(self, message: Twist, sender: str) -> None:
        if sender != self._node.name:
            linear, angular = message.linear.x, message.angular.z
            self._enter(commanded(self._state, self._speed, linear, angular, self._node.now()))

    def _on_safety_stop(self, message: String, _sender: str) -> None:
        self._enter(blinded(self._state, bool(message.data), self._node.now()))

    def _enter(self, state: SpinState) -> None:
        was_turning, self._state = self._state.turning, state
        if state.turning:
            if not was_turning:
                self._node.logger.info("no movement for %.0f s: turning in place", PATIENCE)
            self._publish(state.direction * self._speed)
        elif was_turning:
            self._publish(0.0)

    def _publish(self, angular: float) -> None:
        self._publisher.publish(Twist(Vector3(), Vector3(0.0, 0.0, angular)))


build = SpinRecoverNode


def main() -> int:
    """Runs the node ``controller_spin_recover`` and returns its exit status."""
    run("controller_spin_recover", build)
