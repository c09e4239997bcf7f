"""A node of ROS 2 that sends one goal to each robot and prints where they are: ros2_driver.py NAME X Y [NAME X Y …].

Prints JSON lines: the robot, its true position, and the position that it believes in; both [x, y] in ``map``.
"""

import json
import sys

import rclpy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile

PERIOD = 0.5
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def position(message):
    place = message.pose.pose.position
    return [place.x, place.y]


class Robot:
    def __init__(self, node, name, x, y):
        self.name = name
        self.goal = PoseStamped()
        self.goal.header.frame_id = "map"
        self.goal.pose.position.x = float(x)
        self.goal.pose.position.y = float(y)
        self.goal.pose.orientation.w = 1.0
        self.is_sent = False
        self.true = self.believed = None
        self.goals = node.create_publisher(PoseStamped, f"/{name}/goal_pose", 10)
        node.create_subscription(
            Odometry, f"/{name}/base_pose_ground_truth", self.on_true_position, 10
        )
        node.create_subscription(
            PoseWithCovarianceStamped, f"/{name}/amcl_pose", self.on_believed_position, 10
        )

    def on_true_position(self, message):
        self.true = position(message)

    def on_believed_position(self, message):
        self.believed = position(message)

    def look(self, has_map):
        if self.true and self.goals.get_subscription_count() and not self.is_sent and has_map:
            self.goals.publish(self.goal)
            self.is_sent = True
        report = {"robot": self.name, "true": self.true, "believed": self.believed}
        sys.stdout.write(json.dumps(report | {"sent": self.is_sent}) + "\n")
        sys.stdout.flush()


class Driver:
    def __init__(self, words):
        self.node = rclpy.create_node("driver")
        self.has_map = False
        self.node.create_subscription(OccupancyGrid, "/map", self.on_map, LATCHED)
        rows = [words[start : start + 3] for start in range(0, len(words), 3)]
        self.robots = [Robot(self.node, *row) for row in rows]
        self.node.create_timer(PERIOD, self.look)

    def on_map(self, _message):
        self.has_map = True

    def look(self):
        for robot in self.robots:
            robot.look(self.has_map)


def main():
    rclpy.init()
    rclpy.spin(Driver(sys.argv[1:]).node)


if __name__ == "__main__":
    main()
