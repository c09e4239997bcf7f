"""Publishes numbered texts on /chatter, long ones on /big, and its arguments once, latched, on /latched."""

import hashlib
import sys

import rospy
from std_msgs.msg import String

MIXED_SIZES = (1_500_000, 1_000_000, 100, 2_000_000, 70_000, 900_000, 8)
"""What follows one another on /mixed [bytes]."""


def text(number: int, size: int) -> str:
    """A text of that size that nobody could make up."""
    return f"{number:08d}" + (hashlib.sha256(str(number).encode()).hexdigest() * (size // 64 + 1))[: size - 8]


def main() -> None:
    rospy.init_node("talker")
    chatter = rospy.Publisher("/chatter", String, queue_size=100)
    big = rospy.Publisher("/big", String, queue_size=5)
    mixed = rospy.Publisher("/mixed", String, queue_size=5)
    latched = rospy.Publisher("/latched", String, queue_size=5, latch=True)
    latched.publish(" ".join(rospy.myargv()[1:]))
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
