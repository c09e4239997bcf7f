#!/usr/bin/env python3
"""Two robots swap the ends of a corridor by using its bay, without a collision."""

import unittest

import rospy
import rostest
from geometry_msgs.msg import Twist, Vector3
from simple_navigation_goals.msg import WaypointQueue
from std_msgs.msg import UInt32

from pioneer_harness.wait import wait_until

GOALS = {"pioneer1": 8.4, "pioneer2": 0.6}
"""Goal of each robot, x [m]."""
LONGEST = 150.0
"""Time limit for both to arrive, on a busy machine [s of wall time]."""


class SwapTest(unittest.TestCase):
    def test_both_robots_reach_the_other_end_and_touch_nothing(self) -> None:
        queues: dict[str, WaypointQueue] = {}
        collisions: dict[str, UInt32] = {}
        goals = {}
        for name in GOALS:
            rospy.Subscriber(
                f"/{name}/map_goal_client/queue", WaypointQueue, self._into(queues, name)
            )
            rospy.Subscriber(f"/{name}/collisions", UInt32, self._into(collisions, name))
            goals[name] = rospy.Publisher(f"/{name}/map_goal", Twist, queue_size=1, latch=True)
        wait_until(lambda: len(queues) == len(GOALS), "the waypoint clients", 60.0)
        for name, x in GOALS.items():
            goals[name].publish(Twist(Vector3(x, 0.0, 0.0), Vector3()))
        wait_until(
            lambda: all(queue.received for queue in queues.values()),
            "the waypoints to arrive",
            10.0,
        )
        wait_until(
            lambda: all(queue.reached + queue.aborted for queue in queues.values()),
            "both robots",
            LONGEST,
        )
        assert {name: queue.reached for name, queue in queues.items()} == dict.fromkeys(GOALS, 1)
        wait_until(lambda: len(collisions) == len(GOALS), "the counts of collisions", 10.0)
        assert {name: count.data for name, count in collisions.items()} == dict.fromkeys(GOALS, 0)

    @staticmethod
    def _into(store, name):
        return lambda message: store.__setitem__(name, message)


if __name__ == "__main__":
    rospy.init_node("swap_test")
    rostest.rosrun("pioneer_traffic", "swap", SwapTest)
