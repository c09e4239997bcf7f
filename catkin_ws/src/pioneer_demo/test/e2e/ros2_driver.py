"""A node of ROS 2 that sends one goal to each robot and prints where they are: ros2_driver.py NAME X Y [NAME X Y …].

Prints JSON lines: the robot, its true position, and the position that it believes in, both [x, y] in ``map``; how many
beams its scan has, and the simulated time.
"""

import json
import sys

import rclpy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan

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
        self.beams = 0
        self.goals = node.create_publisher(PoseStamped, f"/{name}/goal_pose", 10)
        node.create_subscription(
            Odometry, f"/{name}/base_pose_ground_truth", self.on_true_position, 10
        )
        node.create_subscription(
            PoseWithCovarianceStamped, f"/{name}/amcl_pose", self.on_believed_position, 10
        )
        node.create_subscription(
            LaserScan, f"/{name}/base_scan", self.on_scan, qos_profile_sensor_data
        )

    def on_true_position(self, message):
        self.true = position(message)

    def on_believed_position(self, message):
        self.believed = position(message)

    def on_scan(self, message):
        self.beams = len(message.ranges)

    def look(self, has_map, clock):
        if self.true and self.goals.get_subscription_count() and not self.is_sent and has_map:
            self.goals.publish(self.goal)
            self.is_sent = True
        report = {"robot": self.name, "true": self.true, "believed": self.believed}
        report |= {"sent": self.is_sent, "beams": self.beams, "clock": clock}
        sys.stdout.write(json.dumps(report) + "\n")
        sys.stdout.flush()


class Driver:
    def __init__(self, words):
        self.node = rclpy.create_node("driver")
        self.has_map = False
        self.clock = 0
        self.node.create_subscription(OccupancyGrid, "/map", self.on_map, LATCHED)
        self.node.create_subscription(Clock, "/clock", self.on_clock, qos_profile_sensor_data)
        rows = [words[start : start + 3] for start in range(0, len(words), 3)]
        self.robots = [Robot(self.node, *row) for row in rows]
        self.node.create_timer(PERIOD, self.look)

    def on_map(self, _message):
        self.has_map = True

    def on_clock(self, message):
        self.clock = message.clock.sec

    def look(self):
        for robot in self.robots:
            robot.look(self.has_map, self.clock)


def main():
    rclpy.init()
    rclpy.spin(Driver(sys.argv[1:]).node)


if __name__ == "__main__":
    main()
