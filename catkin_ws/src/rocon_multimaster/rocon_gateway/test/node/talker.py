"""Publishes numbered texts on /chatter, long ones on /big, and its arguments once, latched, on /latched."""

import hashlib
import sys

import rospy
from std_msgs.msg import String


def text(number: int, size: int) -> str:
    """A text of that size that nobody could make up."""
    return f"{number:08d}" + (hashlib.sha256(str(number).encode()).hexdigest() * (size // 64 + 1))[: size - 8]


def main() -> None:
    rospy.init_node("talker")
    chatter = rospy.Publisher("/chatter", String, queue_size=100)
    big = rospy.Publisher("/big", String, queue_size=5)
    latched = rospy.Publisher("/latched", String, queue_size=5, latch=True)
    latched.publish(" ".join(rospy.myargv()[1:]))
    number = 0
    while not rospy.is_shutdown():
        chatter.publish(text(number, 80))
        if number % 10 == 0:
            big.publish(text(number, 700_000))
        number += 1
        rospy.rostime.wallsleep(0.01)


if __name__ == "__main__":
    sys.exit(main())
