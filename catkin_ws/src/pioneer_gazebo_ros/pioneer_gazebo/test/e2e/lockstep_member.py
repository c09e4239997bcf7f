"""A node in lockstep: adds its name and the time to a file in each period, and hears what the one before it said."""

import os
import sys
from pathlib import Path

import rospy
from std_msgs.msg import String

from pioneer_node.nodes import entry


class MemberNode:
    """Publishes and subscribes ``/said``."""

    def __init__(self) -> None:
        self._file = Path(os.environ["DIARY"])
        self._heard: list[str] = []
        rospy.Subscriber("/said", String, lambda message: self._heard.append(message.data))
        self._publisher = rospy.Publisher("/said", String, queue_size=1)

    def step(self) -> None:
        """Writes a line, and publishes."""
        name, now = rospy.get_name().rpartition("/")[2], rospy.get_time()
        with self._file.open("a") as file:
            file.write(f"{now:.2f} {name} {','.join(self._heard)}\n")
        self._heard.clear()
        self._publisher.publish(f"{name}@{now:.2f}")


if __name__ == "__main__":
    sys.exit(entry.run(os.environ["MEMBER"], MemberNode))
