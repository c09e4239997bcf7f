"""The coordinator node: accepts goals and sends move_base the stretches that the robot may drive."""

import math
import queue
import threading
import time
from dataclasses import dataclass

import rospy
from actionlib_msgs.msg import GoalID
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseGoal
from nav_bundle.msg import NavigationState
from nav_msgs.msg import OccupancyGrid

from nav_bundle.base.conversions import stamped_from_pose
from nav_bundle.base.error import NavigationError
from nav_bundle.base.pose import Pose
from nav_bundle.base.topics import TransformListener, robot_frame
from nav_bundle.base.transform import TransformError
from nav_bundle.base.transform_store import FUTURE_LIMIT
from nav_bundle.maps.conversions import GridMessage, grid_from_message
from pioneer_node.core.parameter import config_from_mapping
from pioneer_node.nodes import entry
from pioneer_node.nodes.kept_parameter import KeptParameter
from pioneer_node.nodes.rospy_handle import RospyHandle
from pioneer_node.nodes.standing_warning import StandingWarning
from pioneer_traffic.config import PilotConfig
from pioneer_traffic.conversions import (
    message_from_report,
    message_from_status,
    report_from_message,
)
from pioneer_traffic.event import (
    Action,
    CancelDrive,
    CancelRequested,
    Drive,
    Event,
    Finish,
    GoalCancelled,
    Heard,
    Inputs,
    MoveBaseTaken,
    NewGoal,
    NewRoadmap,
    Note,
    Send,
    Status,
    StretchEnded,
)
from pioneer_traffic.goal_server import GoalServer
from pioneer_traffic.msg import Report as ReportMessage
from pioneer_traffic.pilot import Pilot
from pioneer_traffic.roadmap import FreeSpace, Roadmap
from pioneer_traffic.roadmap_cache import cached_roadmap
from simple_navigation_goals.move_base import MoveBase
from simple_navigation_goals.queue import Outcome

_PERIOD = 0.2
"""Period of steps [s of wall time, or of simulated time in lockstep; this holds for the times below, too]."""
_SHORTEST = 0.02
"""Minimum time between two steps when goals and cancels arrive [s]."""
_COMPLAIN_EVERY = 10.0
_HELD = "traffic/held"
"""Parameter in the robot's namespace: why the robot stays until its next goal; empty if it does not."""


class _GoalArrived:
    """Marks when a goal arrived, among the events: a stop that arrived later counts."""


@dataclass(frozen=True)
class CoordinatorNodeConfig(PilotConfig):
    """``robot``: the robot's unique name. ``fleet``: names of the fleet's robots, separated by spaces."""

    robot: str = ""
    fleet: str = ""


class CoordinatorNode:
    """Keeps the right of way for one robot.

    Subscribes: ``/map`` (nav_msgs/OccupancyGrid), ``/traffic/reports`` (pioneer_traffic/Report), tf;
        ``move_base/cancel`` (actionlib_msgs/GoalID) and ``move_base/goal`` (move_base_msgs/MoveBaseActionGoal) of
        other nodes, which stop the robot; goals (``nodes.goal_server``).

    Publishes: ``/traffic/reports`` at up to 5 Hz of wall time; in lockstep, of simulated time. ``traffic/state``
        (nav_bundle/NavigationState, latched): what the robot does by the right of way, and why it does not get on.

    Actions served: ``traffic`` (move_base_msgs/MoveBaseAction). Called: ``move_base``.

    Parameters: ``CoordinatorNodeConfig``; ``traffic/held`` keeps why the robot is held, for the node's next start.

    Threads: callbacks only store events and wake ``spin`` (in lockstep ``step``), which does all the work.

    On error: goals end with the reason (``core.pilot``). Without a transform, the robot counts as where it was last,
        and takes no further places; it can be stopped nevertheless.
    """

    def __init__(self) -> None:
        config = config_from_mapping(CoordinatorNodeConfig, entry.parameters(), rospy.get_name())
        self._robot = config.robot or rospy.get_namespace().strip("/") or "robot"
        self._fleet = [name for name in config.fleet.split() if name != self._robot]
        self._base = robot_frame("base_link")
        self._lost = StandingWarning("the transform to map has come", _COMPLAIN_EVERY)
        self._listener = TransformListener()
        self._listener.listen("map", self._base)
        for name in self._fleet:
            self._listener.listen("map", f"{name}/base_link")
        self._events: queue.SimpleQueue[Event | _GoalArrived | ReportMessage] = queue.SimpleQueue()
        self._kept: list[Event] = []  # events that arrived before the first period of a lockstep
        self._wake = threading.Event()
        self._hold = KeptParameter(_HELD, "")
        self._pilot = Pilot(self._robot, config, self._fleet, str(self._hold.value))
        self._roadmap: Roadmap | None = None
        self._reporting: set[str] = set()
        self._stepped_at = -math.inf
        self._target: PoseStamped | None = None
        self._publisher = rospy.Publisher(
            "/traffic/reports", ReportMessage, queue_size=5, tcp_nodelay=True
        )
        self._state = rospy.Publisher("traffic/state", NavigationState, queue_size=1, latch=True)
        self._shown: Status | None = None
        handle = RospyHandle()
        self._name = handle.name
        self._move_base = MoveBase(handle, "move_base", self._on_stretch_end)
        handle.subscribe("move_base/cancel", GoalID, self._on_move_base_cancel)
        handle.subscribe("move_base/goal", MoveBaseActionGoal, self._on_move_base_goal)
        self._server = GoalServer(
            handle, self._listener, self._on_goal, self._wake.set, self._on_cancel
        )
        rospy.Subscriber("/map", GridMessage, self._on_map, queue_size=1)
        rospy.Subscriber(
            "/traffic/reports", ReportMessage, self._events.put, queue_size=100, tcp_nodelay=True
        )

    def _on_stretch_end(self, serial: int, outcome: Outcome, text: str) -> None:
        self._events.put(StretchEnded(serial, outcome, text))
        self._wake.set()

    def _on_goal(self) -> None:
        self._events.put(_GoalArrived())
        self._wake.set()

    def _on_cancel(self, cancel: GoalID, sender: str) -> None:
        """Notes a cancel request at ``traffic``; those with an id alone are for the action server."""
        if not cancel.id or cancel.stamp:
            self._note_cancel(cancel, sender, 0)

    def _on_move_base_cancel(self, cancel: GoalID, sender: str) -> None:
        if sender != self._name:
            self._note_cancel(cancel, sender, self._move_base.serial_of(cancel.id))

    def _note_cancel(self, cancel: GoalID, sender: str, number: int) -> None:
        stamp = cancel.stamp.to_sec()
        if stamp - rospy.get_time() > FUTURE_LIMIT:
            return  # move_base drops it, too, and warns
        everything = not cancel.id and not cancel.stamp
        self._events.put(CancelRequested(everything, number, stamp, f"cancelled by {sender}"))
        self._wake.set()

    def _on_move_base_goal(self, _goal: MoveBaseActionGoal, sender: str) -> None:
        if sender != self._name:
            self._events.put(MoveBaseTaken(sender))
            self._wake.set()

    def _on_map(self, message: OccupancyGrid) -> None:
        """Computes the roadmap here: in the loop, it would delay stops."""
        try:
            grid = grid_from_message(message)
        except NavigationError as error:
            rospy.logerr("the map is not used: %s", error)
            return
        self._events.put(NewRoadmap(cached_roadmap(FreeSpace.of_grid(grid))))

    def spin(self) -> None:
        """Runs at a fixed wall-time period, and as soon as a goal or a stop arrives, until shutdown."""
        entry.on_shutdown(self._wake.set)
        while not entry.is_ending():
            begin = time.monotonic()
            self._work(begin)
            entry.wait(_SHORTEST)
            self._wake.wait(begin + _PERIOD - time.monotonic())
            self._wake.clear()
        self._move_base.cancel()

    def ready(self) -> bool:
        """Returns whether the map has arrived; called in the same thread as ``step``."""
        self._kept.extend(self._take_events())
        return self._roadmap is not None

    def step(self) -> None:
        """Does the work of one period in lockstep, if a report is due."""
        now = rospy.get_time()
        if self._wake.is_set() or not 0.0 <= now - self._stepped_at < _PERIOD - 1.0e-6:
            self._wake.clear()
            self._work(now)

    def _work(self, now: float) -> None:
        if now < self._stepped_at:
            self._server.forget()
        self._stepped_at = now
        events = [*self._kept, *self._take_events()]
        self._kept = []
        position = self._position(self._base)
        if position is None:
            self._lost.warn(f"waiting for the transform from {self._base} to map")
        else:
            self._lost.end()
        silent = (
            self._position(f"{name}/base_link")
            for name in self._fleet
            if name not in self._reporting
        )
        inputs = Inputs(
            position=position,
            stamp=rospy.get_time(),
            present=self._is_move_base_present(),
            obstacles=tuple(point for point in silent if point is not None),
        )
        for action in self._pilot.step(events, inputs, now):
            self._do(action)
        self._hold.keep(self._pilot.held)
        self._show(self._pilot.status)

    def _show(self, status: Status) -> None:
        """Publishes what the robot does, if that has changed."""
        if status != self._shown:
            self._shown = status
            self._state.publish(message_from_status(status, rospy.Time.now()))

    def _take_events(self) -> list[Event]:
        """Returns the pilot's events since the last call, in the order of arrival."""
        events: list[Event] = []
        while not self._events.empty():
            item = self._events.get()
            match item:
                case _GoalArrived():
                    events.extend(self._accepted())
                case NewRoadmap(roadmap):
                    self._roadmap = roadmap
                    rospy.loginfo(
                        "roadmap of %d places, signature %08x",
                        len(roadmap.places),
                        roadmap.signature,
                    )
                    events.append(item)
                case ReportMessage():
                    events.extend(self._heard(item))
                case _:
                    events.append(item)
        reason = self._server.cancelled()
        if reason:
            events.append(GoalCancelled(reason))
        return events

    def _accepted(self) -> list[Event]:
        target = self._server.take()
        if target is None:
            return []
        self._target = target
        return [NewGoal((target.pose.position.x, target.pose.position.y))]

    def _heard(self, message: ReportMessage) -> list[Event]:
        if self._roadmap is None:
            return []
        report = report_from_message(message, self._roadmap.signature, len(self._roadmap.places))
        if report is None:
            return []
        self._reporting.add(report.robot)
        return [Heard(report)]

    def _is_move_base_present(self) -> bool:
        present = self._move_base.present()
        if not present:
            self._move_base.forget()
        return present

    def _position(self, frame: str) -> tuple[float, float] | None:
        try:
            pose = self._listener.lookup("map", frame).planar()
        except TransformError:
            return None
        return pose.x, pose.y

    def _do(self, action: Action) -> None:
        match action:
            case Drive():
                self._move_base.send(MoveBaseGoal(self._stop_pose(action)))
            case CancelDrive():
                self._move_base.cancel()
            case Finish(outcome, text):
                self._server.finish(outcome, text)
            case Send(report):
                self._publisher.publish(message_from_report(report, rospy.Time.now()))
            case Note(text):
                rospy.logwarn("%s", text)

    def _stop_pose(self, drive: Drive) -> PoseStamped:
        """Returns the goal's own pose at the goal; elsewhere a pose facing along the route."""
        if drive.final and self._target is not None:
            return self._target
        yaw = math.atan2(drive.stop[1] - drive.before[1], drive.stop[0] - drive.before[0])
        return stamped_from_pose(Pose(*drive.stop, yaw), "map", rospy.Time.now())


def main() -> int:
    """Runs the node; returns the exit status."""
    return entry.run("coordinator", CoordinatorNode)
