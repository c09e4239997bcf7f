"""A node of one topic: `probe.py talk|hear NAME TOPIC`. Hearing appends a line `seconds text` for each message."""

import sys
import time

import rospy
from std_msgs.msg import String


def heard(message: String) -> None:
    sys.stdout.write(f"{time.monotonic()} {message.data}\n")
    sys.stdout.flush()


def main() -> None:
    what, name, topic = rospy.myargv(sys.argv)[1:]
    rospy.init_node(name)
    if what == "hear":
        rospy.Subscriber(topic, String, heard)
        rospy.spin()
    publisher = rospy.Publisher(topic, String, queue_size=10)
    while not rospy.is_shutdown():
        publisher.publish(name)
        rospy.rostime.wallsleep(0.02)


main()
