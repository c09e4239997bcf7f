#!/usr/bin/env python3
"""ESTOP and cancel_waypoint against a real waypoint client and controller; the test simulates the rest of the robot."""

import os
import signal
import subprocess
import tempfile
import unittest
from pathlib import Path

import rospy
import rostest
from actionlib import ActionServer
from geometry_msgs.msg import Twist, Vector3
from move_base_msgs.msg import MoveBaseAction
from simple_navigation_goals.msg import WaypointQueue

from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

TIMEOUT = 30.0


class StopTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.goals: list[object] = []
        cls.server = ActionServer(
            "/pioneer1/move_base", MoveBaseAction, cls.on_goal, cls.on_cancel, auto_start=False
        )
        cls.server.start()
        cls.status: WaypointQueue | None = None
        rospy.Subscriber("/pioneer1/map_goal_client/queue", WaypointQueue, cls.on_status)
        cls.waypoints = rospy.Publisher("/pioneer1/map_goal", Twist, queue_size=10)
        cls.commands = rospy.Publisher("/pioneer1/cmd_vel", Twist, queue_size=10)
        cls.driven: list[Twist] = []
        rospy.Subscriber(
            "/pioneer1/pioneer/cmd_vel", Twist, lambda message: cls.driven.append(message)
        )
        topics = (cls.waypoints, cls.commands)
        wait_until(
            lambda: all(topic.get_num_connections() for topic in topics) and cls.status,
            "the nodes",
            TIMEOUT,
        )

    @classmethod
    def on_goal(cls, goal) -> None:
        goal.set_accepted()
        cls.goals.append(goal)

    @classmethod
    def on_cancel(cls, goal) -> None:
        goal.set_canceled()

    @classmethod
    def on_status(cls, status: WaypointQueue) -> None:
        cls.status = status

    def drive(self) -> None:
        for x in (1.0, 2.0):
            self.waypoints.publish(Twist(Vector3(x, 0.0, 0.0), Vector3()))
        wait_until(
            lambda: self.status.state == WaypointQueue.DRIVING and self.status.waiting,
            "driving",
            TIMEOUT,
        )

    def stands(self) -> bool:
        return self.status.state == WaypointQueue.IDLE and not self.status.waiting

    def test_cancel_waypoint_clears_the_queue_and_cancels_the_goal(self) -> None:
        self.drive()
        result = subprocess.run(
            ["rosrun", "pioneer_control", "cancel_waypoint", "pioneer1"], timeout=30
        )
        assert result.returncode == 0
        wait_until(self.stands, "an empty queue", TIMEOUT)

    def test_cancel_waypoint_of_a_robot_that_is_not_here_fails(self) -> None:
        command = ["rosrun", "pioneer_control", "cancel_waypoint", "pioneer7"]
        result = subprocess.run(command, timeout=30, capture_output=True, text=True)
        assert result.returncode == 1
        assert "no move_base here of pioneer7" in result.stderr + result.stdout

    def test_estop_once_cancels_and_ends(self) -> None:
        self.drive()
        assert (
            subprocess.run(["rosrun", "pioneer_control", "ESTOP", "--once"], timeout=30).returncode
            == 0
        )
        wait_until(self.stands, "an empty queue", TIMEOUT)

    def test_estop_has_the_last_word_until_it_is_interrupted(self) -> None:
        with ProcessGroup() as group:
            log = Path(tempfile.mkdtemp()) / "estop.log"
            pid = group.start(
                "ESTOP", ["rosrun", "pioneer_control", "ESTOP"], log=log, may_end=True
            )
            wait_until(lambda: "robots held still: 1" in log.read_text(), "ESTOP to hold", TIMEOUT)
            self.driven.clear()
            self.commands.publish(Twist(Vector3(1.0, 0.0, 0.0), Vector3()))
            wait_until(
                lambda: Twist(Vector3(1.0, 0.0, 0.0), Vector3()) in self.driven,
                "the command",
                TIMEOUT,
            )
            wait_until(lambda: self.driven[-1] == Twist(), "the stop after it", TIMEOUT)
            received = self.status.received
            self.waypoints.publish(Twist(Vector3(3.0, 0.0, 0.0), Vector3()))
            wait_until(
                lambda: self.status.received > received, "the waypoint to be received", TIMEOUT
            )
            wait_until(self.stands, "the new waypoint to be cancelled", TIMEOUT)
            os.kill(pid, signal.SIGINT)
            wait_until(lambda: not group.is_running("ESTOP"), "ESTOP to end", TIMEOUT)


if __name__ == "__main__":
    rospy.init_node("stop_test")
    rostest.rosrun("pioneer_control", "stop", StopTest)
