"""A robot that drives its waypoints over and over."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import rospy
from simple_navigation_goals.msg import WaypointQueue

from pioneer_fleet.core.geometry import Pose
from pioneer_web import conversions

FEWEST = 2
"""Waypoints of a patrol."""


class Patrol:
    """Appends each waypoint again once the robot is through with it; ends when all of them are dropped.

    Subscribes: the robot's map_goal_client/queue, whether a page is open or not.

    Args:
        robot: its name.
        route: the waypoints that it has, in order.
        append: appends one to those of the robot.
        on_end: called when somebody has dropped them.
    """

    def __init__(
        self, robot: str, route: Sequence[Pose], append: Callable[[Pose], None], on_end: Callable[[], None]
    ) -> None:
        self._length, self._next, self._append, self._on_end = len(route), itertools.cycle(route), append, on_end
        self._due = 0
        self._subscriber = rospy.Subscriber(
            f"/{robot}/map_goal_client/queue", WaypointQueue, self._on_queue, queue_size=1
        )

    def end(self) -> None:
        """Leaves the robot those waypoints that it has."""
        self._subscriber.unregister()

    def _on_queue(self, message: Any) -> None:
        there = len(conversions.goals_from_queue(message))
        if not there:
            self._on_end()
        # The last one that was appended has arrived.
        elif there < self._length and message.received >= self._due:
            self._due = message.received + 1
            self._append(next(self._next))
