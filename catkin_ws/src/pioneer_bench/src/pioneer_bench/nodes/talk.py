"""Publisher for the gateway's bench: `talk NAME TOPIC SIZE RATE QUEUE`; a rate of 0 is as fast as possible.

Each message begins with the time it was sent: monotonic seconds, a little-endian double. The node also prints the
time at which its publisher was registered. It publishes only while there are subscribers.
"""

import struct
import sys
import threading
import time
from typing import Any

import rospy
from std_msgs.msg import UInt8MultiArray

from pioneer_node.nodes import entry

STAMP = struct.Struct("<d")


class Raw(rospy.AnyMsg):
    """A std_msgs/UInt8MultiArray that is already serialised, so that rospy does not limit the rate."""

    _type = UInt8MultiArray._type
    _md5sum = UInt8MultiArray._md5sum
    _full_text = UInt8MultiArray._full_text


class Demand(rospy.SubscribeListener):
    """Tracks whether there are subscribers, until the end."""

    def __init__(self) -> None:
        super().__init__()
        self.is_there = threading.Event()
        self._lock = threading.Lock()
        self._over = False

    def end(self) -> None:
        """Releases all waiting threads permanently: subscribers leave during shutdown."""
        with self._lock:
            self._over = True
            self.is_there.set()

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        """Records that there is a subscriber."""
        self.is_there.set()

    def peer_unsubscribe(self, topic_name: str, num_peers: int) -> None:
        """Records that there are no more subscribers."""
        with self._lock:
            if not num_peers and not self._over:
                self.is_there.clear()


class Talker:
    """Publishes at the given rate, or as fast as possible, while there are subscribers."""

    def __init__(self, topic: str, size: int, rate: float, queue: int) -> None:
        self._demand = Demand()
        entry.on_shutdown(self._demand.end)
        self._head, self._body = struct.pack("<III", 0, 0, size), bytes(size - STAMP.size)
        self._publisher = rospy.Publisher(
            topic, Raw, self._demand, tcp_nodelay=True, queue_size=queue or None
        )
        self._period = 1 / rate if rate else 0.0
        print(time.monotonic(), flush=True)

    def spin(self) -> None:
        """Runs until shutdown."""
        message, due = Raw(), 0.0
        while True:
            self._demand.is_there.wait()
            if rospy.is_shutdown():
                return
            if self._period:
                due = max(due + self._period, time.monotonic())
                rospy.rostime.wallsleep(max(0.0, due - time.monotonic()))
            message._buff = self._head + STAMP.pack(time.monotonic()) + self._body
            self._publisher.publish(message)


def main() -> int:
    """Entry point."""
    name, topic, size, rate, queue = rospy.myargv(sys.argv)[1:]
    return entry.run(name, lambda: Talker(topic, int(size), float(rate), int(queue)))


if __name__ == "__main__":
    sys.exit(main())
