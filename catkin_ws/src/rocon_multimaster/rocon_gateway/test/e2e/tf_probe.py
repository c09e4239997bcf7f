"""A /tf node: `tf_probe.py talk` publishes transforms of two robots; `hear` appends a line for each child frame."""

import sys

import rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage


def talk() -> None:
    publisher = rospy.Publisher("/tf", TFMessage, queue_size=10)
    names = [(f"pioneer{number}/odom", f"pioneer{number}/base_link") for number in (1, 2)]
    while not rospy.is_shutdown():
        transforms = []
        for parent, child in [
            pair for odom, base in names for pair in (("map", odom), (odom, base))
        ]:
            transform = TransformStamped(child_frame_id=child)
            transform.header.frame_id, transform.transform.rotation.w = parent, 1.0
            transforms.append(transform)
        publisher.publish(TFMessage(transforms))
        rospy.rostime.wallsleep(0.1)


def heard(message: TFMessage) -> None:
    sys.stdout.write("".join(f"{one.child_frame_id}\n" for one in message.transforms))
    sys.stdout.flush()


if __name__ == "__main__":
    rospy.init_node(f"tf_{sys.argv[1]}")
    if sys.argv[1] == "talk":
        talk()
    rospy.Subscriber("/tf", TFMessage, heard)
    rospy.spin()
