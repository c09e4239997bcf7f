"""ROS 1's side of the test: two robots that publish known values, and print what they receive as JSON lines."""

import contextlib
import json
import sys

import rospy
from actionlib_msgs.msg import GoalID
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TransformStamped, Twist
from nav_msgs.msg import OccupancyGrid, Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Empty
from tf2_msgs.msg import TFMessage

RATE = 20
ROBOTS = ("pioneer1", "pioneer2")


def received(topic: str, values: list[float] | list[str]) -> None:
    sys.stdout.write(json.dumps({"topic": topic, "values": values}) + "\n")
    sys.stdout.flush()


def transform(parent: str, child: str, x: float) -> TransformStamped:
    stamped = TransformStamped()
    stamped.header.frame_id = parent
    stamped.child_frame_id = child
    stamped.transform.translation.x = x
    stamped.transform.rotation.w = 1.0
    return stamped


def on_door(message: DiagnosticArray) -> None:
    """Prints what is not in order, and what once was not."""
    for status in message.status:
        if status.level != DiagnosticStatus.OK:
            received(status.name, [status.message])


class Robot:
    def __init__(self, number: int, name: str) -> None:
        self.number = number
        self.name = name
        self.scan = rospy.Publisher(f"/{name}/base_scan", LaserScan, queue_size=1)
        self.odometry = rospy.Publisher(f"/{name}/odom", Odometry, queue_size=1)
        rospy.Subscriber(f"/{name}/pioneer/cmd_vel", Twist, self.on_velocity)
        rospy.Subscriber(f"/{name}/map_goal_pose", PoseStamped, self.on_goal)
        rospy.Subscriber(f"/{name}/map_goal_client/cancel", Empty, self.on_cancel, "waypoints")
        rospy.Subscriber(f"/{name}/move_base/cancel", GoalID, self.on_cancel, "goal")

    def on_velocity(self, message: Twist) -> None:
        received(f"/{self.name}/pioneer/cmd_vel", [message.linear.x, message.angular.z])

    def on_goal(self, message: PoseStamped) -> None:
        received(f"/{self.name}/map_goal_pose", [message.pose.position.x, message.pose.position.y])

    def on_cancel(self, _message: object, what: str) -> None:
        received(f"/{self.name}/cancelled", [what])

    def publish(self) -> None:
        scan = LaserScan(angle_min=-1.0, range_max=30.0, ranges=[self.number + 0.25, 2.5])
        scan.header.frame_id = f"{self.name}/laser"
        self.scan.publish(scan)
        odometry = Odometry(child_frame_id=f"{self.name}/base_link")
        odometry.pose.pose.position.x = self.number + 0.5
        self.odometry.publish(odometry)


def main() -> None:
    rospy.init_node("robot")
    robots = [Robot(number, name) for number, name in enumerate(ROBOTS, 1)]
    rospy.Subscriber("/ros2_door/topics", DiagnosticArray, on_door)
    clock = rospy.Publisher("/clock", Clock, queue_size=1)
    moving = rospy.Publisher("/tf", TFMessage, queue_size=1)
    static = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
    static.publish([transform(f"{name}/base_link", f"{name}/laser", 0.1) for name in ROBOTS])
    grid = OccupancyGrid(data=[0, 100, -1])
    grid.info.width = 3
    grid.info.height = 1
    world = rospy.Publisher("/map", OccupancyGrid, queue_size=1, latch=True)
    world.publish(grid)
    rate = rospy.Rate(RATE)
    while not rospy.is_shutdown():
        clock.publish(rospy.Time(12, 500))
        moving.publish([transform("map", f"{robot.name}/odom", robot.number) for robot in robots])
        for robot in robots:
            robot.publish()
        rate.sleep()


if __name__ == "__main__":
    with contextlib.suppress(rospy.ROSInterruptException):
        main()
