#!/usr/bin/env python3
"""The controller from outside: scaling, rejected commands, and the stop after a timeout in simulated time."""

import math
import unittest

import rospy
import rostest
from geometry_msgs.msg import Twist, Vector3
from rosgraph_msgs.msg import Clock

from pioneer_harness.wait import wait_until

TIMEOUT = 30.0


class ControllerTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.received: list[Twist] = []
        cls.time = 10.0
        cls.clock = rospy.Publisher("/clock", Clock, queue_size=10, latch=True)
        cls.commands = rospy.Publisher("cmd_vel", Twist, queue_size=10)
        rospy.Subscriber("pioneer/cmd_vel", Twist, lambda message: cls.received.append(message))
        cls.tick()
        wait_until(
            lambda: cls.commands.get_num_connections() == 1, "the controller to listen", TIMEOUT
        )
        cls.command(1.0, 0.0)
        wait_until(lambda: cls.connected(), "the controller to be heard", TIMEOUT)

    @classmethod
    def connected(cls) -> bool:
        if not cls.received:
            cls.command(1.0, 0.0)
        return bool(cls.received)

    @classmethod
    def tick(cls, seconds: float = 0.0) -> None:
        cls.time += seconds
        cls.clock.publish(Clock(rospy.Time.from_sec(cls.time)))

    @classmethod
    def command(cls, linear: float, angular: float) -> None:
        cls.commands.publish(Twist(Vector3(linear, 0.0, 0.0), Vector3(0.0, 0.0, angular)))

    def setUp(self) -> None:
        self.command(0.0, 0.0)
        wait_until(lambda: self.received[-1] == Twist(), "the stop", TIMEOUT)
        self.received.clear()

    def test_a_command_is_scaled_by_the_gains(self) -> None:
        self.command(0.5, 1.0)
        wait_until(lambda: self.received, "the command", TIMEOUT)
        assert (self.received[0].linear.x, self.received[0].angular.z) == (1.0, 0.5)

    def test_a_command_that_is_not_finite_is_dropped_and_the_next_one_passes(self) -> None:
        self.command(math.nan, 0.0)
        self.command(0.0, math.inf)
        self.command(0.25, 0.0)
        wait_until(lambda: self.received, "the good command", TIMEOUT)
        assert [message.linear.x for message in self.received] == [0.5]

    def test_a_source_that_falls_silent_while_moving_is_stopped_once(self) -> None:
        self.command(0.5, 0.0)
        wait_until(lambda: len(self.received) == 1, "the command", TIMEOUT)
        self.tick(0.4)
        self.tick(0.2)
        wait_until(lambda: len(self.received) == 2, "the stop", TIMEOUT)
        assert self.received[1] == Twist()


if __name__ == "__main__":
    rospy.init_node("controller_test")
    rostest.rosrun("pioneer_ros", "controller", ControllerTest)
