"""Stops all robots known to a ROS master."""

import threading
import time

import rosgraph
import rospy
from actionlib_msgs.msg import GoalID, GoalStatusArray
from geometry_msgs.msg import Twist
from std_srvs.srv import Empty

from pioneer_control.core.target import Targets, any_live, targets_from_graph

_LOOK_EVERY = 0.05  # [s of wall time]


class Fleet:
    """The robots of one master, refreshed by ``discover``. All waits use wall time, so they work while paused.

    Args:
        robots: namespaces to restrict it to; empty for all.
        hold: whether to answer any other node's velocity command with an immediate stop.
    """

    def __init__(self, robots: list[str], hold: bool = False) -> None:
        self.targets = Targets()
        self._robots, self._hold = robots, hold
        self._master = rosgraph.Master(rospy.get_name())
        self._commands: dict[str, rospy.Publisher] = {}
        self._cancels: dict[str, rospy.Publisher] = {}
        self._live: dict[str, bool] = {}
        self._subscribers: list[rospy.Subscriber] = []

    def discover(self) -> Targets:
        """Queries the master and connects to new robots."""
        publishers, subscribers, services = (
            dict[str, list[str]](part) for part in self._master.getSystemState()
        )
        self.targets = targets_from_graph(publishers, subscribers, services, rospy.get_name()).of(
            self._robots
        )
        for topic in self.targets.commands - self._commands.keys():
            # Latched, so that the message arrives as soon as the connection is made, however late.
            publisher = rospy.Publisher(topic, Twist, queue_size=1, latch=True, tcp_nodelay=True)
            self._commands = {**self._commands, topic: publisher}  # another thread may be in `stop`
            if self._hold:
                self._subscribers.append(
                    rospy.Subscriber(topic, Twist, self._on_command, topic, queue_size=1)
                )
        for action in self.targets.actions - self._cancels.keys():
            self._cancels[action] = rospy.Publisher(
                f"{action}/cancel", GoalID, queue_size=1, latch=True
            )
            self._subscribers.append(
                rospy.Subscriber(f"{action}/status", GoalStatusArray, self._on_status, action)
            )
        return self.targets

    def stop(self) -> None:
        """Commands zero velocity to every robot."""
        for publisher in self._commands.values():
            publisher.publish(Twist())

    def cancel(self) -> None:
        """Clears every waypoint queue and cancels every goal, without waiting for completion."""
        for service in self.targets.clears:
            threading.Thread(target=_clear, args=(service,), daemon=True).start()
        for publisher in self._cancels.values():
            publisher.publish(GoalID())

    def wait_until_cancelled(self, timeout: float) -> list[str]:
        """Waits [s of wall time] until no goal is active; returns the actions whose goals may still be active."""
        deadline = time.monotonic() + timeout
        while left := sorted(
            action for action in self.targets.actions if self._live.get(action, True)
        ):
            if time.monotonic() >= deadline or rospy.is_shutdown():
                break
            rospy.rostime.wallsleep(_LOOK_EVERY)
        return left

    def _on_status(self, message: GoalStatusArray, action: str) -> None:
        self._live[action] = any_live(status.status for status in message.status_list)

    def _on_command(self, message: Twist, topic: str) -> None:
        if message != Twist() and message._connection_header["callerid"] != rospy.get_name():
            self._commands[topic].publish(Twist())


def _clear(service: str) -> None:
    try:
        rospy.ServiceProxy(service, Empty)()
    except rospy.ServiceException as error:
        rospy.logwarn("%s did not answer: %s", service, error)
