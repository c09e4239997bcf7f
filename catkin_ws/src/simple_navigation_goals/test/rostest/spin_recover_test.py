#!/usr/bin/env python3
"""The spin recovery seen from outside. The test sets the clock, and advances it only once the node has caught up."""

import unittest
import xmlrpc.client
from collections.abc import Callable

import rosgraph
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from geometry_msgs.msg import Twist, Vector3
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from pioneer_harness.wait import wait_until

TIMEOUT = 60.0
NODE = "/pioneer1/controller_spin_recover"


class SpinRecoverTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.time = 100.0
        cls.turns: list[float] = []
        cls.clock = rospy.Publisher("/clock", Clock, queue_size=10)
        cls.status = rospy.Publisher("move_base/status", GoalStatusArray, queue_size=10)
        cls.commands = rospy.Publisher("cmd_vel", Twist, queue_size=10)
        cls.stop = rospy.Publisher("move_base/safety_stop", String, queue_size=10)
        cls.own = rospy.Subscriber("cmd_vel", Twist, cls.on_command)
        topics = (cls.status, cls.commands, cls.stop)
        wait_until(
            lambda: all(topic.impl.has_connection(NODE) for topic in topics),
            "the node to listen",
            TIMEOUT,
        )
        wait_until(
            lambda: cls.clock.impl.has_connection(NODE), "the node to hear the clock", TIMEOUT
        )
        wait_until(
            lambda: any(link.callerid_pub == NODE for link in cls.own.impl.connections),
            "its topic",
            TIMEOUT,
        )
        cls.node = xmlrpc.client.ServerProxy(rosgraph.Master("/spin_recover_test").lookupNode(NODE))

    @classmethod
    def on_command(cls, message: Twist) -> None:
        if message._connection_header["callerid"] == NODE:
            cls.turns.append(message.angular.z)

    def pass_time(self, seconds: float) -> None:
        type(self).time += seconds

    def read_from(self, topic: str) -> int:
        """Returns how many bytes the node has read from this test."""
        _, heard, _ = self.node.getBusStats("/spin_recover_test")[2]
        return sum(
            connection[1]
            for name, connections in heard
            if name == topic
            for connection in connections
        )

    def tell(self, topic: str, publish: Callable[[], None]) -> None:
        """Publishes a message twice: once the node has read the second one, it has handled the first."""
        for _ in range(2):
            before = self.read_from(topic)
            publish()
            wait_until(lambda: self.read_from(topic) > before, f"the node to read {topic}", TIMEOUT)  # noqa: B023 - done within the round

    def say(self, active: bool) -> None:
        """Sets the clock, publishes move_base's status, and waits until the node has handled both."""
        self.tell("/clock", lambda: self.clock.publish(Clock(rospy.Time.from_sec(self.time))))
        status = [GoalStatus(status=GoalStatus.ACTIVE)] if active else []
        self.tell(
            "/pioneer1/move_base/status",
            lambda: self.status.publish(GoalStatusArray(status_list=status)),
        )

    def command(self, turn: float) -> None:
        """Publishes a turn [rad/s] as move_base's command, and waits until the node has handled it."""
        self.tell(
            "/pioneer1/cmd_vel",
            lambda: self.commands.publish(Twist(Vector3(), Vector3(0.0, 0.0, turn))),
        )

    def stand_until_it_turns(self) -> float:
        """Advances time in steps with an active goal; returns how long it took until the node turned the robot."""
        start = self.time
        self.turns.clear()

        def turned() -> bool:
            self.pass_time(0.2)
            self.say(active=True)
            return any(self.turns)

        wait_until(turned, "a turn", TIMEOUT)
        return self.time - start

    def tearDown(self) -> None:
        def quiet() -> bool:
            self.pass_time(0.2)
            self.say(active=False)
            return not self.turns or self.turns[-1] == 0.0

        wait_until(quiet, "the end of the turn", TIMEOUT)

    def test_a_robot_stuck_with_a_goal_turns_after_five_seconds(self) -> None:
        self.say(active=True)
        self.command(-0.3)
        assert self.stand_until_it_turns() > 4.0
        assert self.turns[0] == -0.8

    def test_the_turn_has_the_last_word_while_it_lasts_and_ends_with_a_stop(self) -> None:
        self.say(active=True)
        self.stand_until_it_turns()
        turn = self.turns[-1]
        answers = len(self.turns)
        self.command(-0.1 * turn)
        wait_until(lambda: len(self.turns) > answers, "an answer to the command", TIMEOUT)
        assert abs(turn) == 0.8
        assert self.turns[-1] == turn
        start = self.time

        def stopped() -> bool:
            self.pass_time(0.2)
            self.say(active=True)
            return self.turns[-1] == 0.0

        wait_until(stopped, "the stop", TIMEOUT)
        assert self.time - start >= 1.2

    def test_a_safety_stop_of_move_base_stops_the_turn_and_begins_none(self) -> None:
        self.say(active=True)
        self.stand_until_it_turns()
        topic = "/pioneer1/move_base/safety_stop"
        self.addCleanup(self.tell, topic, lambda: self.stop.publish(""))
        self.tell(topic, lambda: self.stop.publish("no scans"))
        wait_until(lambda: self.turns[-1] == 0.0, "the stop", TIMEOUT)
        self.turns.clear()
        for _ in range(40):
            self.pass_time(0.2)
            self.say(active=True)
        assert not any(self.turns)

    def test_a_goal_that_ends_stops_the_turn(self) -> None:
        self.say(active=True)
        self.stand_until_it_turns()
        self.pass_time(0.1)
        self.say(active=False)
        wait_until(lambda: self.turns[-1] == 0.0, "the stop", TIMEOUT)


if __name__ == "__main__":
    rospy.init_node("spin_recover_test")
    rostest.rosrun("simple_navigation_goals", "spin_recover", SpinRecoverTest)
