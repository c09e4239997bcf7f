"""Publishes numbered texts on /chatter, long ones on /big, and its arguments once, latched, on /latched.

On /flood it publishes without a queue, as fast as its only subscriber reads; on /tf_static two latched frames. On
/tf_latched each new subscriber gets the frames `left` and `right` in messages of their own, as from two latched
publishers in one process.
"""

import hashlib
import sys
import threading

import rospy
from geometry_msgs.msg import TransformStamped
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

MIXED_SIZES = (1_500_000, 1_000_000, 100, 2_000_000, 70_000, 900_000, 8)
"""What follows one another on /mixed [bytes]."""


FLOOD_SIZE = 1_000_000
"""Of each message on /flood [bytes]."""


def text(number: int, size: int) -> str:
    """Returns a text of the given size that cannot occur by chance."""
    return (
        f"{number:08d}"
        + (hashlib.sha256(str(number).encode()).hexdigest() * (size // 64 + 1))[: size - 8]
    )


class Flood(rospy.SubscribeListener):
    """Publishes while it has a subscriber."""

    def __init__(self) -> None:
        super().__init__()
        self._is_wanted = threading.Event()
        self._publisher = rospy.Publisher("/flood", String, self, queue_size=None)
        rospy.core.add_preshutdown_hook(lambda _reason: self._is_wanted.set())
        threading.Thread(target=self._run, daemon=True).start()

    def peer_subscribe(self, _topic, _publish, _peer_publish) -> None:
        self._is_wanted.set()

    def peer_unsubscribe(self, _topic, number_of_peers) -> None:
        if not number_of_peers:
            self._is_wanted.clear()

    def _run(self) -> None:
        number, rest = 0, "x" * (FLOOD_SIZE - 8)
        while not rospy.is_shutdown():
            self._is_wanted.wait()
            self._publisher.publish(f"{number:08d}{rest}")
            number += 1


class Burst(rospy.SubscribeListener):
    """Publishes three poses for each of two frames, all with one stamp, to each new subscriber, and then nothing."""

    def peer_subscribe(self, _topic, _publish, peer_publish) -> None:
        for x in range(3):
            for name in ("left", "right"):
                one = TransformStamped(child_frame_id=name)
                one.header.stamp.secs, one.transform.translation.x = 1, x
                peer_publish(TFMessage([one]))


def main() -> None:
    rospy.init_node("talker")
    Flood()
    several = rospy.Publisher("/tf_latched", TFMessage, Burst(), latch=True, queue_size=5)  # noqa: F841
    chatter = rospy.Publisher("/chatter", String, queue_size=100)
    big = rospy.Publisher("/big", String, queue_size=5)
    mixed = rospy.Publisher("/mixed", String, queue_size=5)
    latched = rospy.Publisher("/latched", String, queue_size=5, latch=True)
    latched.publish(" ".join(rospy.myargv()[1:]))
    frames = rospy.Publisher("/tf_static", TFMessage, queue_size=5, latch=True)
    frames.publish([TransformStamped(child_frame_id=f"pioneer{number}/laser") for number in (1, 2)])
    bursts = rospy.Publisher("/tf_burst", TFMessage, Burst(), queue_size=5)  # noqa: F841 # publishes while referenced
    number = 0
    while not rospy.is_shutdown():
        chatter.publish(text(number, 80))
        if number % 10 == 0:
            big.publish(text(number, 700_000))
            mixed.publish(text(number, MIXED_SIZES[number // 10 % len(MIXED_SIZES)]))
        number += 1
        rospy.rostime.wallsleep(0.01)


if __name__ == "__main__":
    sys.exit(main())
