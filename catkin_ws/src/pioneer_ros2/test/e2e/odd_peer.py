"""A node of rclpy that uses the door in odd ways: odd_peer.py types|qos|flood. Prints what it gets as JSON lines."""

import json
import sys

import rclpy
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

PERIOD = 0.1
FLOOD = 500
"""Messages at once, in each period."""


def received(topic, values):
    sys.stdout.write(json.dumps({"topic": topic, "values": values}) + "\n")
    sys.stdout.flush()


def begin_types(node):
    """Writes and reads other types than the fleet's."""
    publisher = node.create_publisher(String, "/pioneer1/cmd_vel", 10)
    node.create_subscription(String, "/pioneer1/odom", lambda _: None, 10)
    node.create_timer(PERIOD, lambda: publisher.publish(String(data="stop")))


def begin_qos(node):
    """Requests what is offered on request only, offers less than the door requests, requests what it never offers."""
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(
        Odometry,
        "/pioneer1/odom",
        lambda message: received("/pioneer1/odom", [message.pose.pose.position.x]),
        latched,
    )
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    goals = node.create_publisher(PoseStamped, "/pioneer1/goal_pose", best_effort)
    goal = PoseStamped()
    goal.pose.position.x = 7.0
    node.create_timer(PERIOD, lambda: goals.publish(goal))
    punctual = QoSProfile(depth=1, deadline=Duration(seconds=1))
    node.create_subscription(Odometry, "/pioneer2/odom", lambda _: None, punctual)


def begin_flood(node):
    """Writes velocities faster than anybody can take them."""
    publisher = node.create_publisher(Twist, "/pioneer2/cmd_vel", 10)
    message = Twist()
    message.linear.x = 0.125

    def flood():
        for _ in range(FLOOD):
            publisher.publish(message)

    node.create_timer(PERIOD, flood)


def main():
    rclpy.init()
    node = rclpy.create_node("odd")
    {"types": begin_types, "qos": begin_qos, "flood": begin_flood}[sys.argv[1]](node)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
