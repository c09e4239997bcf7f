"""The shared part of both waypoint clients: receives waypoints, queues them, and sends goals to move_base."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from actionlib_msgs.msg import GoalID
from geometry_msgs.msg import PoseStamped, Twist
from move_base_msgs.msg import MoveBaseGoal
from std_msgs.msg import Empty as EmptyMessage
from std_srvs.srv import Empty, EmptyResponse, Trigger, TriggerRequest, TriggerResponse

from pioneer_node.adapters.node_handle import NodeHandle
from pioneer_node.core.parameter import config_from_mapping
from pioneer_node.nodes.standing_warning import StandingWarning
from simple_navigation_goals.conversions import (
    message_from_queue,
    pose_from_waypoint,
    waypoint_from_pose,
    waypoint_from_twist,
)
from simple_navigation_goals.move_base import MoveBase
from simple_navigation_goals.msg import WaypointQueue as WaypointQueueMessage
from simple_navigation_goals.patrol import PatrolError
from simple_navigation_goals.queue import Outcome, QueueConfig, WaypointQueue
from simple_navigation_goals.waypoint import Waypoint, WaypointError
from simple_navigation_goals.waypoint_file import QueueFile, QueueFileError, read_patrol

_TICK = 0.25  # period of the check whether move_base is running [s, wall time]
_PATIENCE = 2.0  # time until a warning about a missing transform [s, wall time]
_FILE_PERIOD = 30.0  # time between two warnings about a file that cannot be written [s, wall time]


@dataclass(frozen=True)
class GoalClientConfig(QueueConfig):
    """Action and files of the client; an empty file name means none.

    ``action``: name of the action that takes the goals: move_base, or a node that forwards to it. ``patrol``: YAML
    file of a patrol to start with; see ``core.patrol``. ``queue_file``: file to which the remaining waypoints are
    written at each change, and from which they are read at start.
    """

    action: str = "move_base"
    patrol: str = ""
    queue_file: str = ""


class GoalClientNode:
    """Drives a robot along a queue of waypoints by sending one goal after the other to move_base.

    Subscribes:
        <topic> (geometry_msgs/Twist): waypoint: linear.x, linear.y [m], angular.z heading [DEGREES], in ``frame``.
        <topic>_pose (geometry_msgs/PoseStamped): waypoint as a pose in the frame of its header.
        ~cancel (std_msgs/Empty): like the service ~clear; as a topic it crosses gateways with one flip from the far
        side.

    Publishes:
        ~queue (WaypointQueue, latched): on every change.

    Services:
        ~clear (std_srvs/Empty): drops all waypoints and the patrol, and cancels the active goal.
        ~patrol (std_srvs/Trigger): reads the file ~patrol (again) and starts its patrol.

    Actions called: ~action (move_base_msgs/MoveBaseAction). If that is not move_base but a node that forwards to it,
        the goals of move_base are cancelled when that node ends.

    Parameters: ``GoalClientConfig``; the service ~patrol reads ~patrol again.

    On error: an invalid waypoint is rejected with one line. An unreadable patrol ends the node at start; later the
    service ~patrol returns the error. The node waits for move_base if it is absent, and sends the waypoint again if
    move_base restarts.

    Args:
        node: the node.
        topic: topic of the waypoints.
        frame: default frame of the waypoints.
        locate: converts a waypoint into the one to send; returns None while it cannot yet.
    """

    def __init__(
        self,
        node: NodeHandle,
        topic: str,
        frame: str,
        locate: Callable[[Waypoint], Waypoint | None] = lambda waypoint: waypoint,
    ) -> None:
        config = config_from_mapping(GoalClientConfig, node.parameters(), node.name)
        self._node, self._frame, self._locate = node, frame, locate
        self._queue, self._file = WaypointQueue(config, config.action), QueueFile(config.queue_file)
        self._unwritten = StandingWarning(
            "waypoints are remembered again", _FILE_PERIOD, node.logger
        )
        self._present = False
        self._due_since: float | None = None
        self._resting_since: float | None = None
        self._publisher = node.advertise("~queue", WaypointQueueMessage, latch=True)
        self._acts = node.every(_TICK, self._act)
        self._move_base = MoveBase(node, config.action, self._on_done)
        #: cancels what a server that has ended still makes move_base do
        self._cancels = (
            node.advertise("move_base/cancel", GoalID) if config.action != "move_base" else None
        )
        node.subscribe(topic, Twist, partial(self._on_waypoint, waypoint_from_twist))
        node.subscribe(f"{topic}_pose", PoseStamped, partial(self._on_waypoint, waypoint_from_pose))
        node.subscribe("~cancel", EmptyMessage, self._clear)
        node.serve("~clear", Empty, self._clear)
        node.serve("~patrol", Trigger, self._on_patrol)
        self._resume()
        if config.patrol:
            self._queue.patrol(read_patrol(Path(config.patrol), frame))
        self._publish()
        self._acts.start()

    def _act(self) -> None:
        self._tell()
        self._rest()
        self._look_for_server()
        self._send_due()
        self._tell()

    def _resume(self) -> None:
        try:
            kept = self._file.read()
        except QueueFileError as error:
            self._node.logger.warning("%s; starting without", error)
            return
        for waypoint in kept.waypoints:
            self._queue.add(waypoint)
        if kept.held:
            self._queue.hold()

    def _on_waypoint(
        self, convert: Callable[[Any, str], Waypoint], message: Any, _sender: str
    ) -> None:
        try:
            waypoint = convert(message, self._frame)
        except WaypointError as error:
            self._node.logger.error("waypoint refused: %s", error)
            return
        self._queue.add(waypoint)
        self._acts.now()

    def _clear(self, *_: object) -> EmptyResponse:
        if self._queue.clear():
            self._move_base.cancel()
        self._acts.now()
        return EmptyResponse()

    def _on_patrol(self, _request: TriggerRequest) -> TriggerResponse:
        path = self._node.parameter("~patrol", "")
        if not path:
            return TriggerResponse(
                False, f"parameter {self._node.resolved('~patrol')} is not set to a file"
            )
        try:
            patrol = read_patrol(Path(str(path)), self._frame)
        except PatrolError as error:
            return TriggerResponse(False, str(error))
        if self._queue.patrol(patrol):
            self._move_base.cancel()
        self._acts.now()
        return TriggerResponse(
            True, f"{len(patrol.waypoints)} waypoints, {patrol.rounds or 'endless'} rounds"
        )

    def _on_done(self, _serial: int, outcome: Outcome, text: str) -> None:
        self._queue.finished(outcome, text)
        self._acts.now()

    def _rest(self) -> None:
        """Lets the robot stand for the wait of the waypoint that it reached, in ROS time."""
        now = self._node.now()
        if self._queue.rest == 0.0:
            self._resting_since = None
        elif self._resting_since is None:
            self._resting_since = now
        elif not 0.0 <= now - self._resting_since < self._queue.rest:
            self._resting_since = None
            self._queue.rested()

    def _look_for_server(self) -> None:
        present = self._move_base.present()
        if present == self._present:
            return
        self._present = present
        if present:
            self._queue.server_found()
        else:
            self._move_base.forget()
            self._queue.server_lost()
            if self._cancels is not None:
                # With a stamp, it also holds for goals that arrive after it.
                self._cancels.publish(GoalID(stamp=self._node.stamp()))

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
        self._move_base.send(MoveBaseGoal(pose_from_waypoint(goal, self._node.stamp())))
        self._queue.sent(goal)

    def _say_if_late(self, due: Waypoint) -> None:
        if self._due_since is None:
            self._due_since = time.monotonic()
        elif time.monotonic() - self._due_since > _PATIENCE:
            self._node.logger.warning("waiting for the transform from %s to map", due.frame)
            self._due_since = float("inf")

    def _tell(self) -> None:
        events = self._queue.take_events()
        if not events:
            return
        for event in events:
            (self._node.logger.warning if event.trouble else self._node.logger.info)(
                "%s", event.text
            )
        self._publish()

    def _publish(self) -> None:
        try:
            self._file.write(self._queue.remaining, self._queue.held)
            self._unwritten.end()
        except QueueFileError as error:
            self._unwritten.warn(str(error))
        self._publisher.publish(message_from_queue(self._queue, self._frame, self._node.stamp()))
