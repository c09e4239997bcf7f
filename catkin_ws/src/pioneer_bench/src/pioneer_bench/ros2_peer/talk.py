"""Publishes poses in ROS 2 with monotonic stamps until it is ended: `talk.py TOPIC RATE`."""

import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped


def main() -> None:
    """Entry point."""
    topic, rate = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node("talker")
    publisher = node.create_publisher(PoseStamped, topic, 10)
    message = PoseStamped()

    def send() -> None:
        now = time.monotonic_ns()
        message.header.stamp.sec = now // 10**9
        message.header.stamp.nanosec = now % 10**9
        publisher.publish(message)

    node.create_timer(1.0 / float(rate), send)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
