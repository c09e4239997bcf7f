"""Turns a robot in place when it has a goal and has not been driven for a while."""

import math
import threading
from dataclasses import dataclass

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from geometry_msgs.msg import Twist, Vector3

from pioneer_node.core.parameter import ParameterError, config_from_mapping
from pioneer_node.nodes.entry import parameters, run
from simple_navigation_goals.core.spin import SpinConfig, SpinState, commanded, watched

_MAX_VEL_THETA = "move_base/TrajectoryPlannerROS/max_vel_theta"


@dataclass(frozen=True)
class RecoverConfig:
    """``cmd_vel_topic``: where move_base's commands are seen and the recovery's are sent."""

    cmd_vel_topic: str = "cmd_vel"


class SpinRecoverNode:
    """Watches move_base and its commands; a robot that stands for 5 s with a goal turns in place for 1.5 s.

    Subscribes:
        move_base/status (actionlib_msgs/GoalStatusArray): whether a goal is active; also the clock of this node.
        <cmd_vel_topic> (geometry_msgs/Twist): what move_base commands.

    Publishes:
        <cmd_vel_topic> (geometry_msgs/Twist): the turn, repeated with each status and after each command that
        move_base gives meanwhile, so that the last word is the turn; at its end one zero.

    Parameters: ``RecoverConfig``; move_base/TrajectoryPlannerROS/max_vel_theta [rad/s], read at the start
    and with each goal, 1.0 where it is not set.

    Threads: both callbacks take one lock; nothing polls. All times are ROS times.

    On error: a max_vel_theta that is no positive number ends the node with one line at its start; later it is
    logged, and the last valid one stays.
    """

    def __init__(self) -> None:
        config = config_from_mapping(RecoverConfig, parameters(), rospy.get_name())
        self._config = SpinConfig(max_vel_theta=_max_vel_theta())
        self._state = SpinState()
        self._lock = threading.Lock()
        self._publisher = rospy.Publisher(config.cmd_vel_topic, Twist, queue_size=1, tcp_nodelay=True)
        self._inputs = [
            rospy.Subscriber("move_base/status", GoalStatusArray, self._on_status, queue_size=1),
            rospy.Subscriber(config.cmd_vel_topic, Twist, self._on_command, queue_size=1, tcp_nodelay=True),
        ]

    def _on_status(self, message: GoalStatusArray) -> None:
        active = any(status.status == GoalStatus.ACTIVE for status in message.status_list)
        with self._lock:
            if active and not self._state.active:  # move_base has loaded its parameters by now
                self._reload()
            self._enter(watched(self._state, self._config, active, rospy.get_time()))

    def _reload(self) -> None:
        try:
            self._config = SpinConfig(max_vel_theta=_max_vel_theta())
        except ParameterError as error:
            rospy.logerr("%s", error)

    def _on_command(self, message: Twist) -> None:
        if message._connection_header["callerid"] == rospy.get_name():
            return
        with self._lock:
            now = rospy.get_time()
            self._enter(commanded(self._state, self._config, message.linear.x, message.angular.z, now))

    def _enter(self, state: SpinState) -> None:
        was_turning, self._state = self._state.turning, state
        if state.turning:
            if not was_turning:
                rospy.loginfo("no movement for %.0f s: turning in place", self._config.patience)
            self._publish(state.direction * self._config.max_vel_theta)
        elif was_turning:
            self._publish(0.0)

    def _publish(self, angular: float) -> None:
        self._publisher.publish(Twist(Vector3(), Vector3(0.0, 0.0, angular)))


def _max_vel_theta() -> float:
    value = rospy.get_param(_MAX_VEL_THETA, 1.0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < math.inf:
        raise ParameterError(f"parameter {rospy.resolve_name(_MAX_VEL_THETA)} must be a positive number, not {value!r}")
    return float(value)


def main() -> int:
    """Runs the node ``controller_spin_recover`` and returns its exit status."""
    return run("controller_spin_recover", SpinRecoverNode)
