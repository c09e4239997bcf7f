"""A lockstep member: in each period it appends the time, its name and the messages it received to a file."""

import os
import sys
from pathlib import Path

import rospy
from std_msgs.msg import String

from pioneer_node.nodes import entry


class MemberNode:
    """Publishes and subscribes to ``/said``."""

    def __init__(self) -> None:
        self._file = Path(os.environ["DIARY"])
        self._heard: list[str] = []
        rospy.Subscriber("/said", String, lambda message: self._heard.append(message.data))
        self._publisher = rospy.Publisher("/said", String, queue_size=1)

    def step(self) -> None:
        """Appends a line to the file and publishes."""
        name, now = rospy.get_name().rpartition("/")[2], rospy.get_time()
        with self._file.open("a") as file:
            file.write(f"{now:.2f} {name} {','.join(self._heard)}\n")
        self._heard.clear()
        self._publisher.publish(f"{name}@{now:.2f}")


if __name__ == "__main__":
    sys.exit(entry.run(os.environ["MEMBER"], MemberNode))
