#!/usr/bin/env python3
"""A robot in the simulator reaches its waypoints, stays localised, and collides with nothing."""

import math
import unittest

import rospy
import rostest
from geometry_msgs.msg import Point, PoseStamped, Quaternion, Twist, Vector3
from geometry_msgs.msg import Pose as PoseMessage
from nav_msgs.msg import Odometry
from simple_navigation_goals.msg import WaypointQueue
from std_msgs.msg import Header, UInt32

from nav_bundle.base.conversions import pose_from_message
from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.base.topics import TransformListener
from nav_bundle.base.transform import TransformError
from pioneer_harness.wait import wait_until

WAYPOINTS = ((-2.5, -0.5), (3.5, -3.0))
TOLERANCE = 0.25 + 0.1
"""The goal tolerance of the local planner plus the permitted localisation error [m]."""
LONGEST_LAG = 0.5
"""How long a ground truth waits for the pose estimate of its stamp, which arrives later [s of wall time]."""


class Robot:
    """What the test observes of the robot: ground truth, pose estimate, waypoint queue and collisions."""

    def __init__(self) -> None:
        self.queue: WaypointQueue | None = None
        self.collisions: int | None = None
        self.truth: Pose | None = None
        self.stamp = 0.0
        self.errors: list[float] = []
        self.turn_errors: list[float] = []
        self.length = 0.0
        self.places: list[Pose] = []
        self.listener = TransformListener()
        self.listener.listen("map", "pioneer1/base_link")
        self.goals = rospy.Publisher("map_goal", Twist, queue_size=10)
        rospy.Subscriber("map_goal_client/queue", WaypointQueue, self.on_queue)
        rospy.Subscriber("collisions", UInt32, self.on_collisions)
        rospy.Subscriber("base_pose_ground_truth", Odometry, self.on_truth, queue_size=1)

    def on_collisions(self, message: UInt32) -> None:
        self.collisions = message.data

    def on_queue(self, message: WaypointQueue) -> None:
        if self.queue and message.reached > self.queue.reached and self.truth:
            self.places.append(self.truth)
        self.queue = message

    def on_truth(self, message: Odometry) -> None:
        pose = pose_from_message(message.pose.pose)
        if self.truth:
            self.length += pose.distance(self.truth)
        self.truth, self.stamp = pose, message.header.stamp.to_sec()
        try:
            belief = self.listener.wait(
                "map", "pioneer1/base_link", self.stamp, LONGEST_LAG
            ).planar()
        except TransformError:
            return
        self.errors.append(belief.distance(pose))
        self.turn_errors.append(abs(angle_difference(belief.yaw, pose.yaw)))


class OneRobotTest(unittest.TestCase):
    def test_the_robot_reaches_both_waypoints_without_a_collision_and_knows_where_it_is(
        self,
    ) -> None:
        robot = Robot()
        wait_until(
            lambda: robot.goals.get_num_connections() and robot.queue, "the waypoint client", 60.0
        )
        for x, y in WAYPOINTS:
            robot.goals.publish(Twist(Vector3(x, y, 0.0), Vector3(0.0, 0.0, 0.0)))
        wait_until(lambda: robot.queue.state == WaypointQueue.DRIVING, "the robot to set off", 60.0)
        start = robot.stamp
        wait_until(
            lambda: robot.queue.reached + robot.queue.aborted == len(WAYPOINTS),
            "both waypoints",
            120.0,
        )
        errors = sorted(robot.errors)
        rospy.loginfo(
            "%.1f s, %.2f m, error mean %.3f m, p95 %.3f m, heading mean %.4f rad, %s collisions",
            robot.stamp - start,
            robot.length,
            sum(errors) / len(errors),
            errors[int(0.95 * len(errors))],
            sum(robot.turn_errors) / len(robot.turn_errors),
            robot.collisions,
        )
        assert robot.queue.reached == len(WAYPOINTS), robot.queue.text
        wait_until(lambda: robot.collisions is not None, "the count of collisions", 10.0)
        assert robot.collisions == 0
        assert sum(errors) / len(errors) < 0.10
        for (x, y), place in zip(WAYPOINTS, robot.places, strict=True):
            assert math.hypot(place.x - x, place.y - y) < TOLERANCE
        self.check_a_goal_in_base_link(robot)

    def check_a_goal_in_base_link(self, robot: Robot) -> None:
        heard: list[PoseStamped] = []
        rospy.Subscriber("move_base/current_goal", PoseStamped, heard.append)
        goals = rospy.Publisher("move_base_simple/goal", PoseStamped, queue_size=1)
        wait_until(goals.get_num_connections, "move_base to take simple goals", 10.0)
        ahead = PoseMessage(Point(0.5, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0))
        goals.publish(PoseStamped(Header(0, rospy.Time(), "base_link"), ahead))
        wait_until(lambda: heard, "the goal in map", 10.0)
        assert heard[-1].header.frame_id == "map"
        expected = robot.truth.compose(Pose(0.5, 0.0, 0.0))
        assert pose_from_message(heard[-1].pose).distance(expected) < TOLERANCE


if __name__ == "__main__":
    rospy.init_node("one_robot_test")
    rostest.rosrun("nav_bundle", "one_robot", OneRobotTest)
