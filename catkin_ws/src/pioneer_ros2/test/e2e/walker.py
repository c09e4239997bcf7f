"""Publishes a custom type in ROS 1, which is installed nowhere: the definition travels with the connection."""

import contextlib

import genpy.dynamic
import rospy

NAME = "walker_msgs/Leg"
DEFINITION = "string name\nfloat64[2] reach\nuint8[] toes\n"
RATE = 10


def main() -> None:
    kind = genpy.dynamic.generate_dynamic(NAME, DEFINITION)[NAME]
    rospy.init_node("walker")
    publisher = rospy.Publisher("/walker/leg", kind, queue_size=1)
    rate = rospy.Rate(RATE)
    while not rospy.is_shutdown():
        publisher.publish(kind(name="left", reach=[0.5, -0.25], toes=bytes([1, 2, 3])))
        rate.sleep()


if __name__ == "__main__":
    with contextlib.suppress(rospy.ROSInterruptException):
        main()
