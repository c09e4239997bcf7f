#!/usr/bin/env python3
"""A robot without a map builds one as it drives, reaches a waypoint in it, and stays localised."""

import unittest

import rospy
import rostest
from geometry_msgs.msg import Twist, Vector3
from nav_msgs.msg import OccupancyGrid
from one_robot_test import Robot

from nav_bundle.base.pose import Pose
from nav_bundle.base.transform import TransformError
from nav_bundle.maps.conversions import GridMessage, grid_from_message
from nav_bundle.maps.grid import OCCUPIED
from pioneer_harness.wait import wait_until

START = Pose(-4.5, 3.5, -1.57)
"""Where the robot begins: the origin of its map."""
PLACE = Pose(-2.5, -0.5, 0.0)


class MappingRobotTest(unittest.TestCase):
    def test_the_robot_reaches_a_waypoint_without_a_collision_in_a_map_of_its_own(self) -> None:
        robot = Robot()
        self.map: OccupancyGrid | None = None
        rospy.Subscriber("map", GridMessage, self.on_map, queue_size=1)
        wait_until(
            lambda: robot.goals.get_num_connections() and robot.queue and self.map,
            "waypoint client, map",
            60.0,
        )
        goal = START.inverse().compose(PLACE)
        robot.goals.publish(Twist(Vector3(goal.x, goal.y, 0.0), Vector3(0.0, 0.0, 0.0)))
        wait_until(lambda: robot.queue.reached + robot.queue.aborted == 1, "the waypoint", 90.0)
        assert robot.queue.reached == 1, robot.queue.text
        assert robot.places[0].distance(PLACE) < 0.25 + 0.1
        wait_until(lambda: self.knows_its_place(robot), "a robot that knows where it is", 10.0)
        wait_until(lambda: robot.collisions is not None, "the count of collisions", 10.0)
        assert robot.collisions == 0
        assert (grid_from_message(self.map).cells == OCCUPIED).sum() > 100

    def on_map(self, message: OccupancyGrid) -> None:
        self.map = message

    def knows_its_place(self, robot: Robot) -> bool:
        """Returns whether the robot's pose estimate is within 0.1 m of the truth; False while transforms are late."""
        stamp, truth = robot.stamp, robot.truth
        try:
            belief = robot.listener.lookup("map", "pioneer1/base_link", stamp).planar()
        except TransformError:
            return False
        return START.compose(belief).distance(truth) < 0.1


if __name__ == "__main__":
    rospy.init_node("mapping_robot_test")
    rostest.rosrun("nav_bundle", "mapping_robot", MappingRobotTest)
