#!/usr/bin/env python3
"""Real waypoint clients against a fake move_base that starts late, is killed and restarts."""

import math
import os
import signal
import sys
import tempfile
import unittest
import xmlrpc.client
from pathlib import Path

import rosgraph
import rospy
import rostest
from actionlib_msgs.msg import GoalID
from geometry_msgs.msg import PoseStamped, TransformStamped, Twist, Vector3
from move_base_msgs.msg import MoveBaseActionGoal
from simple_navigation_goals.msg import WaypointQueue
from std_srvs.srv import Empty, Trigger
from tf2_msgs.msg import TFMessage

from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

FAKE = Path(__file__).parent / "fake_move_base.py"
TIMEOUT = 60.0


class Client:
    """One client node seen from outside: its topics, its newest status, and its status texts."""

    def __init__(self, node: str, topic: str) -> None:
        self.node = rospy.resolve_name(node)
        self.status: WaypointQueue | None = None
        self.texts: list[str] = []
        self.publisher = rospy.Publisher(topic, Twist, queue_size=10)
        self.poses = rospy.Publisher(f"{topic}_pose", PoseStamped, queue_size=10)
        rospy.Subscriber(f"{node}/queue", WaypointQueue, self._on_status)
        rospy.wait_for_service(f"{node}/clear", TIMEOUT)
        self.clear = rospy.ServiceProxy(f"{node}/clear", Empty)
        wait_until(
            lambda: self.publisher.get_num_connections() and self.status,
            f"{node} to listen",
            TIMEOUT,
        )

    def _on_status(self, status: WaypointQueue) -> None:
        self.status = status
        self.texts.append(status.text)

    def sends_goals_here(self) -> bool:
        """Returns whether the node's goals reach this test. The node reconnects whenever move_base disappears."""
        uri = rosgraph.Master(rospy.get_name()).lookupNode(self.node)
        with xmlrpc.client.ServerProxy(uri) as slave:
            links = slave.getBusInfo(rospy.get_name())[2]
        goals = rospy.resolve_name("move_base/goal")
        return any((link[1], link[2], link[4]) == (rospy.get_name(), "o", goals) for link in links)

    def go(self, *xs: float) -> None:
        for x in xs:
            self.publisher.publish(Twist(Vector3(x, 2.0, 0.0), Vector3(0.0, 0.0, 90.0)))

    def wait(self, what: str, timeout: float = TIMEOUT, **fields: int) -> WaypointQueue:
        def reached() -> bool:
            return all(getattr(self.status, name) == value for name, value in fields.items())

        wait_until(reached, f"{what}: {fields}", timeout)
        return self.status


class QueueTest(unittest.TestCase):
    """The clients run for the whole test; each case starts or kills move_base as needed."""

    @classmethod
    def setUpClass(cls) -> None:
        cls.group = ProcessGroup()
        cls.logs = Path(tempfile.mkdtemp())
        cls.process: int | None = None
        cls.runs = 0
        cls.map_client = Client("map_goal_client", "map_goal")
        cls.robot_client = Client("base_link_goal_client", "base_link_goal")
        cls.goals: list[MoveBaseActionGoal] = []
        rospy.Subscriber("move_base/goal", MoveBaseActionGoal, lambda goal: cls.goals.append(goal))
        cls.cancel = rospy.Publisher("move_base/cancel", GoalID, queue_size=1)

    @classmethod
    def tearDownClass(cls) -> None:
        cls.group.stop()

    def setUp(self) -> None:
        self.goals.clear()
        self.before = self.map_client.status

    def tearDown(self) -> None:
        self.map_client.clear()
        self.map_client.wait("the queue to be empty", state=WaypointQueue.IDLE, waiting=[])

    def start_move_base(self) -> None:
        cls = type(self)
        if cls.process is None:
            for client in (self.map_client, self.robot_client):
                wait_until(client.sends_goals_here, f"the goals of {client.node}", TIMEOUT)
            cls.runs += 1
            name = f"move_base {cls.runs}"
            cls.process = self.group.start(
                name, [sys.executable, str(FAKE)], log=self.logs / name, may_end=True
            )

    def kill_move_base(self) -> None:
        if self.process is not None:
            os.kill(self.process, signal.SIGKILL)
            wait_until(
                lambda: self.map_client.status.text.startswith("move_base disconnected"),
                "the loss",
                TIMEOUT,
            )
            type(self).process = None

    def sent(self, count: int) -> list[PoseStamped]:
        """Waits for ``count`` goals; returns their poses. Goals and statuses arrive on separate connections."""
        wait_until(lambda: len(self.goals) >= count, f"{count} goals", TIMEOUT)
        return [goal.goal.target_pose for goal in self.goals]

    def counted(self, **added: int) -> dict[str, int]:
        return {name: getattr(self.before, name) + count for name, count in added.items()}

    def test_waypoints_that_come_before_move_base_are_driven_in_order_once_it_is_there(
        self,
    ) -> None:
        self.kill_move_base()
        self.map_client.go(1.0, 2.0, 3.0)
        self.map_client.wait(
            "three waypoints to wait",
            state=WaypointQueue.WAITING_FOR_MOVE_BASE,
            **self.counted(received=3),
        )
        self.start_move_base()
        self.map_client.wait(
            "three waypoints reached", state=WaypointQueue.IDLE, **self.counted(reached=3)
        )
        poses = self.sent(3)
        assert [pose.pose.position.x for pose in poses] == [1.0, 2.0, 3.0]
        pose = poses[0]
        assert pose.header.frame_id == "map"
        assert math.isclose(pose.pose.orientation.z, math.sin(math.pi / 4.0))

    def test_a_waypoint_that_move_base_gives_up_is_skipped_and_counted(self) -> None:
        self.start_move_base()
        self.map_client.go(100.0, 1.0)
        status = self.map_client.wait(
            "one reached, one given up", **self.counted(reached=1, aborted=1)
        )
        assert status.state == WaypointQueue.IDLE
        assert any("gave up" in text and "too far" in text for text in self.map_client.texts)

    def test_a_waypoint_that_is_not_finite_is_refused_and_the_next_is_driven(self) -> None:
        self.start_move_base()
        self.map_client.go(math.nan, math.inf, 1.0)
        status = self.map_client.wait("the good one reached", **self.counted(reached=1))
        assert status.received == self.before.received + 1

    def test_a_move_base_that_is_killed_and_started_again_gets_the_waypoint_again(self) -> None:
        self.start_move_base()
        self.map_client.go(-1.0)
        self.map_client.wait("driving", state=WaypointQueue.DRIVING)
        self.kill_move_base()
        self.map_client.wait("the loss noticed", state=WaypointQueue.WAITING_FOR_MOVE_BASE)
        self.start_move_base()
        self.map_client.wait("driving again", state=WaypointQueue.DRIVING)
        assert [pose.pose.position.x for pose in self.sent(2)] == [-1.0, -1.0]

    def test_clear_cancels_the_goal_under_way_and_drops_the_rest(self) -> None:
        self.start_move_base()
        self.map_client.go(-1.0, 1.0)
        self.map_client.wait("driving", state=WaypointQueue.DRIVING)
        self.map_client.clear()
        status = self.map_client.wait("idle", state=WaypointQueue.IDLE)
        assert (status.waiting, status.reached) == ([], self.before.reached)

    def test_a_patrol_is_driven_and_a_bad_one_is_refused_in_one_line(self) -> None:
        self.start_move_base()
        start = rospy.ServiceProxy("map_goal_client/patrol", Trigger)
        assert "is not set to a file" in start().message
        path = self.logs / "patrol.yaml"
        rospy.set_param("map_goal_client/patrol", str(path))
        path.write_text("waypoints: [{x: 1.0}]")
        answer = start()
        assert (answer.success, answer.message) == (
            False,
            f"the patrol {path}: waypoint 1 has no y",
        )
        path.write_text("{loop: 2, waypoints: [{x: 1.0, y: 0.0, wait: 0.5}, {x: 2.0, y: 0.0}]}")
        assert start().success
        status = self.map_client.wait("two rounds", **self.counted(received=4, reached=4))
        assert [pose.pose.position.x for pose in self.sent(4)] == [1.0, 2.0, 1.0, 2.0]
        assert any("staying 0.5 s" in text for text in self.map_client.texts)
        assert "2 rounds" in status.text

    def test_a_goal_that_somebody_else_cancels_holds_the_rest(self) -> None:
        self.start_move_base()
        self.map_client.go(-1.0, 1.0)
        self.map_client.wait("driving", state=WaypointQueue.DRIVING)
        wait_until(
            lambda: self.map_client.status.waiting and self.cancel.get_num_connections(),
            "both",
            TIMEOUT,
        )
        self.cancel.publish(GoalID())
        status = self.map_client.wait("held", state=WaypointQueue.IDLE)
        assert len(status.waiting) == 1

    def test_a_pose_in_another_frame_goes_to_move_base_in_that_frame(self) -> None:
        self.start_move_base()
        pose = PoseStamped()
        pose.header.frame_id = "/pioneer1/odom"
        pose.pose.orientation.w = 1.0
        self.map_client.poses.publish(pose)
        self.map_client.wait("reached", **self.counted(reached=1))
        assert self.sent(1)[0].header.frame_id == "pioneer1/odom"

    def test_a_waypoint_in_the_robots_frame_is_turned_into_the_map(self) -> None:
        self.start_move_base()
        frames = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        robot = TransformStamped(child_frame_id="pioneer1/base_link")
        robot.header.frame_id = "map"
        robot.transform.translation = Vector3(10.0, 20.0, 0.0)
        robot.transform.rotation.z = robot.transform.rotation.w = math.sqrt(0.5)
        frames.publish(TFMessage([robot]))
        self.robot_client.go(1.0)
        self.robot_client.wait("reached", reached=1)
        pose = self.sent(1)[0]
        assert pose.header.frame_id == "map"
        assert math.isclose(pose.pose.position.x, 8.0)
        assert math.isclose(pose.pose.position.y, 21.0)
        assert math.isclose(abs(pose.pose.orientation.z), 1.0)


if __name__ == "__main__":
    rospy.init_node("queue_test")
    rostest.rosrun("simple_navigation_goals", "queue", QueueTest)
