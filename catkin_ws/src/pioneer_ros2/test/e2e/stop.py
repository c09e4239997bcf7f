"""Sends an emergency stop, or its end, from rclpy until it is killed: stop.py TOPIC true|false."""

import sys

import rclpy
from std_msgs.msg import Bool

PERIOD = 0.2


def main():
    topic, value = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node("stop")
    publisher = node.create_publisher(Bool, topic, 10)
    node.create_timer(PERIOD, lambda: publisher.publish(Bool(data=value == "true")))
    rclpy.spin(node)


if __name__ == "__main__":
    main()
