#!/usr/bin/env python3
"""Golden scenarios: simulated robots with all of their nodes do what a user expects, in time and without collisions.

Each scenario first places the robots in its room (scenario.world). Time limits are simulated seconds.
"""

import math
import unittest

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from scenario_robot import Robot
from scenario_world import START_UP, World

from nav_bundle.base.pose import Pose
from pioneer_harness.wait import wait_until

NO_PLAN = (
    GoalStatus.ABORTED,
    "Failed to find a valid plan. Even after executing recovery behaviors. No way to the goal is known.",
)
RECOVERIES = ["conservative_reset", "rotate_recovery", "aggressive_reset", "rotate_recovery"]
GARAGE = Pose(27.5, 1.5, 0.0)
TOLERANCE = 0.25 + 0.1
"""The goal tolerance of the local planner plus the permitted localisation error [m]."""


class ScenarioTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.world = World()
        cls.first, cls.second = cls.robots = (
            Robot("pioneer1", cls.world),
            Robot("pioneer2", cls.world),
        )
        wait_until(
            lambda: all(robot.up() for robot in cls.robots),
            "both robots and their navigation",
            START_UP,
        )

    def setUp(self) -> None:
        for robot in self.robots:
            robot.recoveries.clear()
        self.before = [robot.collisions for robot in self.robots]

    def tearDown(self) -> None:
        for robot in self.robots:
            robot.halt()
        self.world.clear()
        assert [robot.collisions for robot in self.robots] == self.before, "collisions"
        if self.second.truth.distance(GARAGE) > 1.0:
            self.second.place(GARAGE)

    def assert_arrives(self, robot: Robot, x: float, y: float, limit: float) -> None:
        """Waits until the goal succeeds, and checks that the robot is at the goal."""
        assert self.end(robot, limit) == (GoalStatus.SUCCEEDED, "Goal reached.")
        assert robot.truth.distance(Pose(x, y)) < TOLERANCE

    def end(self, robot: Robot, limit: float) -> tuple[int, str]:
        self.world.wait(lambda: robot.result, f"{robot.name} at the end of its goal", limit)
        return robot.result.status.status, robot.result.status.text

    def test_a_corridor_is_driven_in_one_go(self) -> None:
        self.first.place(Pose(1.0, -4.2, 0.0))
        self.first.send(13.0, -4.2)
        self.assert_arrives(self.first, 13.0, -4.2, 25.0)
        assert self.first.recoveries == []

    def test_two_robots_head_on_in_a_corridor_pass_each_other(self) -> None:
        self.first.place(Pose(1.0, 9.2, 0.0))
        self.second.place(Pose(9.0, 9.2, math.pi))
        self.first.send(9.0, 9.2)
        self.second.send(1.0, 9.2)
        self.assert_arrives(self.first, 9.0, 9.2, 40.0)
        self.assert_arrives(self.second, 1.0, 9.2, 40.0)
        assert self.first.recoveries == self.second.recoveries == []

    def test_a_door_as_wide_as_the_robot_and_15_cm_on_each_side_is_passed_both_ways(self) -> None:
        self.first.place(Pose(17.0, 3.0, -math.pi / 2))
        for x, y in ((22.5, 1.0), (17.5, 1.0)):
            self.first.send(x, y)
            self.assert_arrives(self.first, x, y, 30.0)

    def test_what_crosses_the_way_is_not_run_into(self) -> None:
        self.first.place(Pose(1.0, 1.0, 0.0))
        self.world.spawn("trolley", 0.4, 0.4, Pose(5.0, 3.0))
        self.first.send(9.0, 1.0)
        self.world.wait(lambda: self.first.truth.x > 2.2, "the robot on its way", 10.0)
        began = self.world.time
        while (y := 3.0 - 0.4 * (self.world.time - began)) > 0.3:
            self.world.put("trolley", Pose(5.0, y))
        self.assert_arrives(self.first, 9.0, 1.0, 40.0)

    def test_a_gate_in_a_dead_end_that_opens_late_is_passed_after_recovery(self) -> None:
        self.shut_in()
        self.first.send(17.5, -3.5)
        self.world.wait(lambda: self.first.recoveries, "recovery", 30.0)
        self.world.delete("gate")
        self.assert_arrives(self.first, 17.5, -3.5, 60.0)

    def test_a_goal_behind_a_gate_is_given_up_in_noetics_words_after_four_recoveries(self) -> None:
        self.shut_in()
        self.first.send(17.5, -3.5)
        self.second.send(25.95, 1.5)
        status, text = self.end(self.second, 5.0)
        assert (status, self.second.recoveries) == (GoalStatus.ABORTED, []), (
            "a goal in a wall is answered at once"
        )
        assert text.startswith("The goal (25.95, 1.50) is in an obstacle of the map"), text
        assert self.end(self.first, 60.0) == NO_PLAN
        assert [name.split(" ")[0] for name in self.first.recoveries] == RECOVERIES

    def test_a_robot_carried_off_finds_out_where_it_is_with_recovery_alpha_on(self) -> None:
        self.first.place(Pose(1.0, 1.0, 0.0))
        self.first.recover(0.001, 0.1)
        self.addCleanup(self.first.recover, 0.0, 0.0)
        self.first.carry(Pose(8.6, 4.4, 2.0))
        self.first.wander_until_found(60.0)

    def test_a_robot_that_may_be_anywhere_finds_out_where_it_is(self) -> None:
        self.first.place(Pose(1.0, 5.5, 1.0))
        self.first.lose()
        self.first.wander_until_found(60.0)

    def shut_in(self) -> None:
        """Places the robot in the dead end, with a gate so close to it that no recovery clears the gate."""
        self.first.place(Pose(23.2, -3.5, math.pi))
        self.world.spawn("gate", 0.1, 1.2, Pose(22.55, -3.5))
        wait_until(
            lambda: not self.first.sees_a_way(17.5, -3.5), "the gate in the costmap", START_UP
        )


if __name__ == "__main__":
    rospy.init_node("scenario_test")
    rostest.rosrun("nav_bundle", "scenario", ScenarioTest)
