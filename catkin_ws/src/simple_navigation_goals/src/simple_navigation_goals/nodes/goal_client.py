"""What both waypoint clients share: topics in, a queue, goals out."""

import contextlib
import queue
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import rospy
from geometry_msgs.msg import PoseStamped, Twist
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse

from pioneer_node.core.parameter import config_from_mapping
from pioneer_node.nodes.entry import parameters
from simple_navigation_goals.adapters.move_base import MoveBase
from simple_navigation_goals.conversions import (
    goal_from_waypoint,
    message_from_queue,
    waypoint_from_pose,
    waypoint_from_twist,
)
from simple_navigation_goals.core.error import WaypointError
from simple_navigation_goals.core.queue import Outcome, QueueConfig, WaypointQueue
from simple_navigation_goals.core.waypoint import Waypoint
from simple_navigation_goals.msg import WaypointQueue as WaypointQueueMessage

_TICK = 0.25  # [s of wall time] how often it looks whether move_base is there
_PATIENCE = 2.0  # [s of wall time] before it says that it waits for a transform


class GoalClientNode:
    """Drives a robot along a queue of waypoints, one goal of move_base after the other.

    Subscribes:
        <topic> (geometry_msgs/Twist): linear.x, linear.y [m], angular.z heading [DEGREES], in ``frame``.
        <topic>_pose (geometry_msgs/PoseStamped): the same as a pose in the frame of its header.

    Publishes:
        ~queue (WaypointQueue, latched): on every change.

    Services:
        ~clear (std_srvs/Empty): drops all waypoints and cancels the one under way.

    Actions called: move_base (move_base_msgs/MoveBaseAction).

    Parameters: ``QueueConfig``.

    Threads: rospy's callbacks put what arrived into a queue of events; ``spin`` alone handles them.

    On error: a waypoint that is not finite is refused with one line. A move_base that is absent is waited for, one
    that ends or starts anew gets the waypoint again.

    Args:
        topic: of the waypoints.
        frame: their frame.
        locate: turns a waypoint into the one to send, or returns None while it cannot yet; called in ``spin``.
    """

    def __init__(
        self, topic: str, frame: str, locate: Callable[[Waypoint], Waypoint | None] = lambda waypoint: waypoint
    ) -> None:
        self._queue = WaypointQueue(config_from_mapping(QueueConfig, parameters(), rospy.get_name()))
        self._frame = frame
        self._locate = locate
        self._events: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._present = False
        self._serial = 0
        self._due_since: float | None = None
        self._publisher = rospy.Publisher("~queue", WaypointQueueMessage, queue_size=10, latch=True)
        self._move_base = MoveBase("move_base", self._on_done)
        self._inputs = [
            rospy.Subscriber(topic, Twist, partial(self._on_waypoint, waypoint_from_twist)),
            rospy.Subscriber(f"{topic}_pose", PoseStamped, partial(self._on_waypoint, waypoint_from_pose)),
            rospy.Service("~clear", Empty, self._on_clear),
        ]
        # CPython 3.11 waits for ever in SimpleQueue.get where a signal handler outlasts the timeout: feed it.
        rospy.on_shutdown(lambda: self._events.put(lambda: None))
        self._publish()

    def spin(self) -> None:
        """Handles events until shutdown."""
        while not rospy.is_shutdown():
            with contextlib.suppress(queue.Empty):
                self._events.get(timeout=_TICK)()
            # A shutdown closes move_base's connections first; connecting anew then would wait for a master for ever.
            if rospy.is_shutdown():
                return
            self._tell()
            self._look_for_server()
            self._send_due()
            self._tell()

    def _on_waypoint(self, convert: Callable[[Any, str], Waypoint], message: Any) -> None:
        try:
            waypoint = convert(message, self._frame)
        except WaypointError as error:
            rospy.logerr("waypoint refused: %s", error)
            return
        self._events.put(partial(self._queue.add, waypoint))

    def _on_clear(self, _request: EmptyRequest) -> EmptyResponse:
        self._events.put(self._clear)
        return EmptyResponse()

    def _on_done(self, serial: int, outcome: Outcome, text: str) -> None:
        self._events.put(partial(self._finish, serial, outcome, text))

    def _clear(self) -> None:
        if self._queue.clear():
            self._move_base.cancel()
        self._serial = 0

    def _finish(self, serial: int, outcome: Outcome, text: str) -> None:
        if serial != self._serial:
            return
        self._queue.finished(outcome, text)
        if outcome is Outcome.LOST:
            self._move_base.renew()

    def _look_for_server(self) -> None:
        present = self._move_base.present()
        if present == self._present:
            return
        self._present = present
        if present:
            self._queue.server_found()
        else:
            self._move_base.renew()
            self._serial = 0
            self._queue.server_lost()

    def _send_due(self) -> None:
        due = self._queue.due()
        if due is None:
            self._due_since = None
            return
        goal = self._locate(due)
        if goal is None:
            self._say_if_late(due)
            return
        self._due_since = None
        self._serial = self._move_base.send(goal_from_waypoint(goal, rospy.Time.now()))
        self._queue.sent(goal)

    def _say_if_late(self, due: Waypoint) -> None:
        if self._due_since is None:
            self._due_since = time.monotonic()
        elif time.monotonic() - self._due_since > _PATIENCE:
            rospy.logwarn("waiting for the transform from %s to map", due.frame)
            self._due_since = float("inf")

    def _tell(self) -> None:
        events = self._queue.take_events()
        if not events:
            return
        for event in events:
            level = rospy.logwarn if event.trouble else rospy.loginfo
            level("%s", event.text)
        self._publish()

    def _publish(self) -> None:
        self._publisher.publish(message_from_queue(self._queue, self._frame, rospy.Time.now()))
