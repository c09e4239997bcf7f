"""ROS 2's side of the test, for rclpy: prints what it receives as JSON lines, and sends velocities and a goal."""

import json
import sys

import rclpy
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan

PERIOD = 0.1
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def received(topic, values):
    sys.stdout.write(json.dumps({"topic": topic, "values": values}) + "\n")
    sys.stdout.flush()


class Peer(Node):
    def __init__(self, stamped):
        super().__init__("peer")
        self.create_subscription(Clock, "/clock", self.on_clock, qos_profile_sensor_data)
        self.create_subscription(OccupancyGrid, "/map", self.on_map, LATCHED)
        for name in ("pioneer1", "pioneer2"):
            self.create_subscription(
                LaserScan, f"/{name}/base_scan", self.scan_of(name), qos_profile_sensor_data
            )
            self.create_subscription(
                LaserScan, f"/{name}/scan", self.own_scan_of(name), qos_profile_sensor_data
            )
            self.create_subscription(Odometry, f"/{name}/odom", self.odometry_of(name), 10)
        self.stamped = stamped
        self.velocity = self.create_publisher(
            TwistStamped if stamped else Twist, "/pioneer1/cmd_vel", 10
        )
        self.goal = self.create_publisher(PoseStamped, "/pioneer2/goal_pose", 10)
        self.create_timer(PERIOD, self.send)

    def on_clock(self, message):
        received("/clock", [message.clock.sec, message.clock.nanosec])

    def on_map(self, message):
        received("/map", list(message.data))

    def scan_of(self, name):
        return lambda message: received(
            f"/{name}/base_scan", [*message.ranges, message.header.frame_id]
        )

    def own_scan_of(self, name):
        return lambda message: received(f"/{name}/scan", [*message.ranges, message.header.frame_id])

    def odometry_of(self, name):
        return lambda message: received(
            f"/{name}/odom", [message.pose.pose.position.x, message.child_frame_id]
        )

    def send(self):
        message = TwistStamped() if self.stamped else Twist()
        twist = message.twist if self.stamped else message
        twist.linear.x = 0.25
        twist.angular.z = -0.5
        self.velocity.publish(message)
        goal = PoseStamped()
        goal.header.frame_id = "map"
        goal.pose.position.x = 3.0
        goal.pose.position.y = 4.0
        self.goal.publish(goal)
        received("nodes", sorted(self.get_node_names()))
        types = dict(self.get_topic_names_and_types())
        received("types", types.get("/pioneer1/tf", []))


def main():
    rclpy.init()
    rclpy.spin(Peer(stamped="stamped" in sys.argv))


if __name__ == "__main__":
    main()
