#!/usr/bin/env python3
"""Every way to stop a robot that keeps the right of way ends its goal of move_base within 0.5 s, for good."""

import os
import signal
import sys
import tempfile
import time
import unittest
from collections.abc import Callable
from pathlib import Path

import rospkg
import rospy
import rostest
from actionlib_msgs.msg import GoalID, GoalStatusArray
from geometry_msgs.msg import PoseStamped, Quaternion, TransformStamped, Twist, Vector3
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
from nav_bundle.msg import NavigationState
from nav_msgs.msg import OccupancyGrid
from pioneer_traffic.msg import Report
from simple_navigation_goals.msg import WaypointQueue
from std_msgs.msg import Empty
from tf2_msgs.msg import TFMessage

from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

FAKE = Path(rospkg.RosPack().get_path("simple_navigation_goals")) / "test/rostest/fake_move_base.py"
COORDINATOR = ["rosrun", "pioneer_traffic", "coordinator"]
TIMEOUT = 60.0
STOPPED_WITHIN = 0.5
"""Time from a stop to the end of move_base's goal [s]."""
STATUSES = 15
"""Statuses of move_base, at 5 Hz, during which no goal may follow: a cancelled one used to be sent again after 2 s."""
START, GOAL = -13.0, -4.0
"""Where the robot stands and what it is sent to, x [m]: the fake move_base never ends goals of x < 0."""


class StopTest(unittest.TestCase):
    """The robot never moves: move_base has the end of its first stretch until somebody stops it."""

    @classmethod
    def setUpClass(cls) -> None:
        cls.group = ProcessGroup()
        cls.logs = Path(tempfile.mkdtemp())
        cls.sent: list[MoveBaseActionGoal] = []
        cls.ended: list[MoveBaseActionResult] = []
        cls.results: list[MoveBaseActionResult] = []
        cls.reports: list[Report] = []
        rospy.Subscriber("move_base/goal", MoveBaseActionGoal, lambda goal: cls.sent.append(goal))
        rospy.Subscriber(
            "move_base/result", MoveBaseActionResult, lambda result: cls.ended.append(result)
        )
        rospy.Subscriber(
            "traffic/result", MoveBaseActionResult, lambda result: cls.results.append(result)
        )
        rospy.Subscriber("/traffic/reports", Report, lambda report: cls.reports.append(report))
        cls.state = NavigationState()
        cls.queue = WaypointQueue()
        rospy.Subscriber(
            "traffic/state", NavigationState, lambda state: setattr(cls, "state", state)
        )
        rospy.Subscriber(
            "map_goal_client/queue", WaypointQueue, lambda queue: setattr(cls, "queue", queue)
        )
        cls.waypoints = rospy.Publisher("map_goal", Twist, queue_size=1)
        cls.clear = rospy.Publisher("map_goal_client/cancel", Empty, queue_size=1)
        cls.cancels = {
            name: rospy.Publisher(f"{name}/cancel", GoalID, queue_size=1)
            for name in ("traffic", "move_base")
        }
        cls.goals = {
            name: rospy.Publisher(f"{name}/goal", MoveBaseActionGoal, queue_size=1)
            for name in cls.cancels
        }
        cls.simple_goals = rospy.Publisher("traffic_simple/goal", PoseStamped, queue_size=1)
        cls.publish_surroundings()
        cls.group.start(
            "move_base", [sys.executable, str(FAKE)], log=cls.logs / "move_base", may_end=True
        )
        cls.coordinator = 0
        cls.runs = 0
        cls.start_coordinator()

    @classmethod
    def tearDownClass(cls) -> None:
        cls.group.stop()

    @classmethod
    def publish_surroundings(cls) -> None:
        """Publishes a corridor as the map, and the robot's pose in it."""
        cls.map = rospy.Publisher("/map", OccupancyGrid, queue_size=1, latch=True)
        corridor = OccupancyGrid()
        corridor.header.frame_id = "map"
        corridor.info.resolution = 0.1
        corridor.info.width, corridor.info.height = 120, 30
        corridor.info.origin.position.x, corridor.info.origin.position.y = -14.0, -1.5
        corridor.info.origin.orientation.w = 1.0
        corridor.data = [0] * (120 * 30)
        cls.map.publish(corridor)
        cls.tf = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        pose = TransformStamped()
        pose.header.frame_id, pose.child_frame_id = "map", "pioneer1/base_link"
        pose.transform.translation.x = START
        pose.transform.rotation = Quaternion(0.0, 0.0, 0.0, 1.0)
        cls.tf.publish(TFMessage([pose]))

    @classmethod
    def start_coordinator(cls) -> None:
        cls.runs += 1
        before = len(cls.reports)
        name = f"coordinator {cls.runs}"
        cls.coordinator = cls.group.start(name, COORDINATOR, log=cls.logs / name, may_end=True)
        wait_until(lambda: len(cls.reports) > before, "the coordinator's reports", TIMEOUT)
        ends = (
            *cls.cancels.values(),
            *cls.goals.values(),
            cls.simple_goals,
            cls.clear,
            cls.waypoints,
        )
        wait_until(
            lambda: all(end.get_num_connections() for end in ends), "all connections", TIMEOUT
        )

    def drive(self, start: Callable[[], object] | None = None) -> MoveBaseActionGoal:
        """Sends the robot off, by default with a waypoint; returns the goal that move_base gets."""
        before = len(self.sent)
        (start or self.send_waypoint)()
        wait_until(lambda: len(self.sent) > before, "a goal of move_base", TIMEOUT)
        return self.sent[-1]

    def send_waypoint(self) -> None:
        self.waypoints.publish(Twist(Vector3(GOAL, 0.0, 0.0), Vector3()))

    def goal(self, name: str = "") -> MoveBaseActionGoal:
        goal = MoveBaseActionGoal()
        goal.goal_id.id = name
        goal.goal_id.stamp = rospy.Time.now()
        goal.goal.target_pose = self.pose()
        return goal

    def pose(self) -> PoseStamped:
        pose = PoseStamped()
        pose.header.frame_id = "map"
        pose.pose.position.x = GOAL
        pose.pose.orientation.w = 1.0
        return pose

    def expect_stop(
        self,
        goal: MoveBaseActionGoal,
        stop: Callable[[], object],
        reason: Callable[[], object] | None = None,
    ) -> None:
        """Stops the robot, and checks that move_base's goal ends soon, that no other follows, and the reason given."""
        sent = len(self.sent)
        begin = time.monotonic()
        stop()
        wait_until(lambda: self.has_ended(goal.goal_id.id), "the end of move_base's goal", 10.0)
        took = time.monotonic() - begin
        assert took <= STOPPED_WITHIN, f"stopped after {took:.2f} s"
        wait_until(reason or self.is_held, "the reason in the state", 2.0)
        self.expect_no_goal_after(sent)

    def is_held(self) -> bool:
        return self.state.state == NavigationState.HELD and "until the next goal" in self.state.text

    def expect_no_goal_after(self, count: int) -> None:
        """Checks that move_base gets no goal beyond the first ``count`` while it publishes its status."""
        statuses: list[GoalStatusArray] = []
        watch = rospy.Subscriber("move_base/status", GoalStatusArray, statuses.append)
        wait_until(lambda: len(statuses) >= STATUSES, "move_base's statuses", TIMEOUT)
        watch.unregister()
        assert len(self.sent) == count, f"move_base got another goal: {self.sent[-1]}"

    def has_ended(self, name: str) -> bool:
        return any(result.status.goal_id.id == name for result in self.ended)

    def test_cancelling_all_goals_of_move_base_stops_the_robot(self) -> None:
        self.expect_stop(self.drive(), lambda: self.cancels["move_base"].publish(GoalID()))

    def test_cancelling_move_base_by_id_stops_the_robot(self) -> None:
        goal = self.drive()
        self.expect_stop(
            goal, lambda: self.cancels["move_base"].publish(GoalID(id=goal.goal_id.id))
        )

    def test_cancelling_move_base_by_stamp_stops_the_robot(self) -> None:
        self.expect_stop(
            self.drive(), lambda: self.cancels["move_base"].publish(GoalID(stamp=rospy.Time.now()))
        )

    def test_cancelling_all_goals_of_traffic_stops_the_robot(self) -> None:
        goal = self.drive(lambda: self.goals["traffic"].publish(self.goal()))
        number = len(self.results)
        self.expect_stop(goal, lambda: self.cancels["traffic"].publish(GoalID()))
        assert len(self.results) > number

    def test_cancelling_traffic_by_id_stops_the_robot(self) -> None:
        goal = self.drive(lambda: self.goals["traffic"].publish(self.goal("of this test")))
        self.expect_stop(goal, lambda: self.cancels["traffic"].publish(GoalID(id="of this test")))

    def test_cancelling_traffic_by_stamp_stops_the_robot(self) -> None:
        goal = self.drive(lambda: self.goals["traffic"].publish(self.goal()))
        self.expect_stop(
            goal, lambda: self.cancels["traffic"].publish(GoalID(stamp=rospy.Time.now()))
        )

    def test_clearing_the_waypoints_stops_the_robot(self) -> None:
        self.expect_stop(self.drive(), lambda: self.clear.publish(Empty()))

    def test_a_goal_of_another_node_for_move_base_is_not_replaced(self) -> None:
        goal = self.drive()
        before = len(self.sent)
        self.goals["move_base"].publish(self.goal("by hand"))
        wait_until(
            lambda: self.has_ended(goal.goal_id.id), "the end of the coordinator's goal", 1.0
        )
        wait_until(lambda: len(self.sent) > before, "the goal", 10.0)
        self.expect_no_goal_after(before + 1)
        self.expect_stop(self.sent[-1], lambda: self.cancels["move_base"].publish(GoalID()))

    def test_goals_of_rviz_take_part(self) -> None:
        goal = self.drive(lambda: self.simple_goals.publish(self.pose()))
        assert goal.goal.target_pose.pose.position.x < GOAL - 1.0
        self.expect_stop(goal, lambda: self.cancels["traffic"].publish(GoalID()))

    def test_the_end_of_the_client_stops_the_robot(self) -> None:
        command = ["rostopic", "pub", "traffic/goal", "move_base_msgs/MoveBaseActionGoal"]
        target = f"{{header: {{frame_id: map}}, pose: {{position: {{x: {GOAL}}}, orientation: {{w: 1.0}}}}}}"
        started: list[int] = []

        def start() -> None:
            text = f"{{goal: {{target_pose: {target}}}}}"
            started.append(
                self.group.start("client", [*command, text], log=self.logs / "client", may_end=True)
            )

        goal = self.drive(start)
        self.expect_stop(goal, lambda: os.kill(started[0], signal.SIGKILL))

    def test_the_death_of_the_coordinator_stops_the_robot(self) -> None:
        goal = self.drive()
        try:
            self.expect_stop(
                goal,
                lambda: os.kill(self.coordinator, signal.SIGKILL),
                lambda: "traffic disconnected" in self.queue.text,
            )
            assert self.queue.state == WaypointQueue.WAITING_FOR_MOVE_BASE
        finally:
            self.clear.publish(Empty())
            self.start_coordinator()

    def test_a_robot_that_was_stopped_stays_when_its_coordinator_is_started_again(self) -> None:
        self.expect_stop(self.drive(), lambda: self.cancels["traffic"].publish(GoalID()))
        reason = self.state.text
        os.kill(self.coordinator, signal.SIGKILL)
        type(self).state = NavigationState()
        self.start_coordinator()
        wait_until(self.is_held, "the hold of the coordinator before", 5.0)
        assert self.state.text == reason


if __name__ == "__main__":
    rospy.init_node("stop_test")
    rostest.rosrun("pioneer_traffic", "stop", StopTest)
