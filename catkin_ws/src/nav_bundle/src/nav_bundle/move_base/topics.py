"""A topic that names the reason for a state, such as a robot that may not drive."""

import math

import rospy
from std_msgs.msg import String

from nav_bundle.move_base.reason import is_due


class Reason:
    """A latched topic (std_msgs/String) that holds a reason; empty for none.

    Args:
        topic: its name.
    """

    def __init__(self, topic: str) -> None:
        self._publisher = rospy.Publisher(topic, String, queue_size=1, latch=True)
        self._reason = ""
        self._published = -math.inf
        self._publisher.publish("")

    def publish(self, reason: str, now: float) -> None:
        """Publishes a reason that begins or ends at once; one that only changes, after a while."""
        if reason == self._reason:
            return
        if reason and self._reason and not is_due(reason, self._reason, now - self._published):
            return
        self._reason = reason
        self._published = now
        self._publisher.publish(reason)
