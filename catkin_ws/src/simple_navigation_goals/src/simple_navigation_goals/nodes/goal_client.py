"""What both waypoint clients share: topics in, a queue, goals out."""

import contextlib
import queue
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import rospy
from geometry_msgs.msg import PoseStamped, Twist
from std_msgs.msg import Empty as EmptyMessage
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse, Trigger, TriggerRequest, TriggerResponse

from pioneer_node.core.parameter import ParameterError, config_from_mapping
from pioneer_node.nodes.entry import is_ending, on_shutdown, parameters
from simple_navigation_goals.adapters.move_base import MoveBase
from simple_navigation_goals.adapters.patrol_file import read_patrol
from simple_navigation_goals.adapters.queue_file import QueueFile
from simple_navigation_goals.conversions import (
    goal_from_waypoint,
    message_from_queue,
    waypoint_from_pose,
    waypoint_from_twist,
)
from simple_navigation_goals.core.error import PatrolError, QueueFileError, WaypointError
from simple_navigation_goals.core.patrol import Patrol
from simple_navigation_goals.core.queue import Outcome, QueueConfig, WaypointQueue
from simple_navigation_goals.core.waypoint import Waypoint
from simple_navigation_goals.msg import WaypointQueue as WaypointQueueMessage

_TICK = 0.25  # [s of wall time] how often it looks whether move_base is running
_PATIENCE = 2.0  # [s of wall time] before it says that it waits for a transform


@dataclass(frozen=True)
class GoalClientConfig(QueueConfig):
    """Files, empty for none.

    ``patrol``: YAML file of a patrol to begin with; see ``core.patrol``. ``queue_file``: where the waypoints that are
    left are written at each change, and read from at the start.
    """

    patrol: str = ""
    queue_file: str = ""


class GoalClientNode:
    """Drives a robot along a queue of waypoints, one goal of move_base after the other.

    Subscribes:
        <topic> (geometry_msgs/Twist): linear.x, linear.y [m], angular.z heading [DEGREES], in ``frame``.
        <topic>_pose (geometry_msgs/PoseStamped): the same as a pose in the frame of its header.
        ~cancel (std_msgs/Empty): as the service ~clear; a topic crosses gateways by one flip from the other side.

    Publishes:
        ~queue (WaypointQueue, latched): on every change.

    Services:
        ~clear (std_srvs/Empty): drops all waypoints, a patrol too, and cancels the one under way.
        ~patrol (std_srvs/Trigger): reads the file ~patrol (again) and begins its patrol.

    Actions called: move_base (move_base_msgs/MoveBaseAction).

    Parameters: ``GoalClientConfig``; ~patrol is read again by the service of that name.

    Threads: rospy's callbacks put what arrived into a queue of events; ``spin`` alone handles them.

    On error: a waypoint that is not finite is refused with one line. A patrol that cannot be read ends the node at its
    start, and is the service's answer later. A move_base that is absent is waited for, one
    that ends or restarts gets the waypoint again.

    Args:
        topic: of the waypoints.
        frame: their frame.
        locate: turns a waypoint into the one to send, or returns None while it cannot yet; called in ``spin``.
    """

    def __init__(
        self, topic: str, frame: str, locate: Callable[[Waypoint], Waypoint | None] = lambda waypoint: waypoint
    ) -> None:
        config = config_from_mapping(GoalClientConfig, parameters(), rospy.get_name())
        self._queue, self._file = WaypointQueue(config), QueueFile(config.queue_file)
        self._frame = frame
        self._locate = locate
        self._events: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._present = False
        self._serial = 0
        self._due_since: float | None = None
        self._resting_since: float | None = None
        self._publisher = rospy.Publisher("~queue", WaypointQueueMessage, queue_size=10, latch=True)
        self._move_base = MoveBase("move_base", self._on_done)
        self._inputs = [
            rospy.Subscriber(topic, Twist, partial(self._on_waypoint, waypoint_from_twist)),
            rospy.Subscriber(f"{topic}_pose", PoseStamped, partial(self._on_waypoint, waypoint_from_pose)),
            rospy.Subscriber("~cancel", EmptyMessage, lambda _: self._events.put(self._clear), queue_size=10),
            rospy.Service("~clear", Empty, self._on_clear),
            rospy.Service("~patrol", Trigger, self._on_patrol),
        ]
        self._resume()
        if config.patrol:
            self._queue.patrol(self._read_patrol(config.patrol))
        # CPython 3.11 waits for ever in SimpleQueue.get where a signal handler outlasts the timeout: feed it.
        on_shutdown(lambda: self._events.put(lambda: None))
        self._publish()

    def spin(self) -> None:
        """Handles events until shutdown."""
        while not is_ending():
            with contextlib.suppress(queue.Empty):
                self._events.get(timeout=_TICK)()
            # A shutdown closes move_base's connections first; reconnecting then would wait for a master for ever.
            if is_ending():
                return
            self._act()

    def step(self) -> None:
        """Does one period's work in lockstep: handles all events."""
        while not self._events.empty():
            self._events.get()()
        self._act()

    def _act(self) -> None:
        self._tell()
        self._rest()
        self._look_for_server()
        self._send_due()
        self._tell()

    def _resume(self) -> None:
        try:
            for waypoint in self._file.read():
                self._queue.add(waypoint)
        except QueueFileError as error:
            rospy.logwarn("%s; starting without", error)

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

    def _read_patrol(self, path: str) -> Patrol:
        try:
            return read_patrol(Path(path), self._frame)
        except PatrolError as error:
            raise ParameterError(str(error)) from None

    def _on_patrol(self, _request: TriggerRequest) -> TriggerResponse:
        path = rospy.get_param("~patrol", "")
        if not path:
            return TriggerResponse(False, f"no parameter {rospy.resolve_name('~patrol')} names a file")
        try:
            patrol = self._read_patrol(str(path))
        except ParameterError as error:
            return TriggerResponse(False, str(error))
        self._events.put(partial(self._patrol, patrol))
        return TriggerResponse(True, f"{len(patrol.waypoints)} waypoints, {patrol.rounds or 'endless'} rounds")

    def _on_done(self, serial: int, outcome: Outcome, text: str) -> None:
        self._events.put(partial(self._finish, serial, outcome, text))

    def _clear(self) -> None:
        if self._queue.clear():
            self._move_base.cancel()
        self._serial = 0

    def _patrol(self, patrol: Patrol) -> None:
        if self._queue.patrol(patrol):
            self._move_base.cancel()
        self._serial = 0

    def _rest(self) -> None:
        """Lets the robot stand as long as the waypoint that it reached says, by ROS time."""
        now = rospy.get_time()
        if self._queue.rest == 0.0:
            self._resting_since = None
        elif self._resting_since is None:
            self._resting_since = now
        elif not 0.0 <= now - self._resting_since < self._queue.rest:
            self._resting_since = None
            self._queue.rested()

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
        try:
            self._file.write(self._queue.remaining)
        except QueueFileError as error:
            rospy.logwarn_throttle(30, "%s", error)
        self._publisher.publish(message_from_queue(self._queue, self._frame, rospy.Time.now()))
