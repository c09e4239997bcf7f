"""A publisher for the gateway's bench: `talk NAME TOPIC SIZE RATE QUEUE`; a rate of 0 is as fast as it goes.

Each message begins with the moment it was sent: monotonic seconds, a little-endian double. It prints that moment too
once its publisher is registered. It sends only while somebody subscribes.
"""

import struct
import sys
import threading
import time
from typing import Any

import rospy
from std_msgs.msg import UInt8MultiArray

STAMP = struct.Struct("<d")


class Raw(rospy.AnyMsg):
    """A std_msgs/UInt8MultiArray that is serialised already, so that rospy is not what limits the rate."""

    _type = UInt8MultiArray._type
    _md5sum = UInt8MultiArray._md5sum
    _full_text = UInt8MultiArray._full_text


class Demand(rospy.SubscribeListener):
    """Whether somebody subscribes."""

    def __init__(self) -> None:
        super().__init__()
        self.is_there = threading.Event()

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        """See rospy."""
        self.is_there.set()

    def peer_unsubscribe(self, topic_name: str, num_peers: int) -> None:
        """See rospy."""
        if not num_peers:
            self.is_there.clear()


def main() -> None:
    """Runs until shutdown."""
    name, topic, size, rate, queue = rospy.myargv(sys.argv)[1:]
    rospy.init_node(name)
    demand = Demand()
    rospy.core.add_preshutdown_hook(lambda _reason: demand.is_there.set())
    head, body = struct.pack("<III", 0, 0, int(size)), bytes(int(size) - STAMP.size)
    publisher = rospy.Publisher(topic, Raw, demand, tcp_nodelay=True, queue_size=int(queue) or None)
    print(time.monotonic(), flush=True)
    period, due = 1 / float(rate) if float(rate) else 0.0, 0.0
    message = Raw()
    while not rospy.is_shutdown():
        demand.is_there.wait()
        if period:
            due = max(due + period, time.monotonic())
            rospy.rostime.wallsleep(max(0.0, due - time.monotonic()))
        message._buff = head + STAMP.pack(time.monotonic()) + body
        publisher.publish(message)


if __name__ == "__main__":
    main()
