"""Makes a robot repeat its waypoints."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import rospy
from simple_navigation_goals.msg import WaypointQueue

from pioneer_fleet.geometry import Pose
from pioneer_web.state import conversions

FEWEST = 2
"""Minimum number of waypoints of a patrol."""


class Patrol:
    """Appends each waypoint again once the robot has finished it; ends when the robot's waypoints are cancelled.

    Subscribes: the robot's map_goal_client/queue, even if no page is open.

    Args:
        robot: its name.
        route: its current waypoints, in order.
        append: appends a waypoint to the robot's queue.
        on_end: called when its waypoints have been cancelled.
    """

    def __init__(
        self,
        robot: str,
        route: Sequence[Pose],
        append: Callable[[Pose], None],
        on_end: Callable[[], None],
    ) -> None:
        self._length, self._next, self._append, self._on_end = (
            len(route),
            itertools.cycle(route),
            append,
            on_end,
        )
        self._due = 0
        self._subscriber = rospy.Subscriber(
            f"/{robot}/map_goal_client/queue", WaypointQueue, self._on_queue, queue_size=1
        )

    def end(self) -> None:
        """Stops repeating; the robot keeps its remaining waypoints."""
        self._subscriber.unregister()

    def _on_queue(self, message: Any) -> None:
        there = len(conversions.goals_from_queue(message))
        if not there:
            self._on_end()
        # The robot has received the waypoint appended last.
        elif there < self._length and message.received >= self._due:
            self._due = message.received + 1
            self._append(next(self._next))
