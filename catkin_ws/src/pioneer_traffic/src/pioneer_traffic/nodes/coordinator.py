"""The coordinator node: accepts goals and sends move_base the stretches that the robot may drive."""

import math
import queue
import time
from dataclasses import dataclass

import actionlib
import rospy
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid

from nav_bundle.conversions import GridMessage, grid_from_message, stamped_from_pose
from nav_bundle.core.grid import FREE
from nav_bundle.core.pose import Pose
from nav_bundle.core.transform import TransformError
from nav_bundle.nodes.transform import TransformListener, robot_frame
from pioneer_node.core.frame import stripped
from pioneer_node.core.parameter import config_from_mapping
from pioneer_node.nodes import entry
from pioneer_node.nodes.rospy_handle import RospyHandle
from pioneer_node.nodes.standing_warning import StandingWarning
from pioneer_traffic.conversions import message_from_report, report_from_message
from pioneer_traffic.core.config import CoordinatorConfig
from pioneer_traffic.core.coordinator import Coordinator
from pioneer_traffic.core.roadmap import FreeSpace, Roadmap, roadmap_from_space
from pioneer_traffic.msg import Report as ReportMessage
from simple_navigation_goals.adapters.move_base import MoveBase
from simple_navigation_goals.core.queue import Outcome

_PERIOD = 0.2
"""Period of reports [s of wall time, or of simulated time in lockstep; this holds for the times below, too]."""
_SAME = 0.05
"""Distance below which a stop counts as the one that move_base already has [m]."""
_RETRY = 2.0
"""Delay before a stop that move_base gave up is sent again [s]."""
_COMPLAIN_EVERY = 10.0


@dataclass(frozen=True)
class CoordinatorNodeConfig(CoordinatorConfig):
    """``robot``: the robot's unique name. ``fleet``: names of the fleet's robots, separated by spaces."""

    robot: str = ""
    fleet: str = ""


class CoordinatorNode:
    """Keeps the right of way for one robot.

    Subscribes: ``/map`` (nav_msgs/OccupancyGrid), ``/traffic/reports`` (pioneer_traffic/Report), tf.

    Publishes: ``/traffic/reports`` at 5 Hz of wall time; in lockstep, of simulated time.

    Actions served: ``traffic`` (move_base_msgs/MoveBaseAction), goals in frame map. Called: ``move_base``.

    Parameters: ``CoordinatorNodeConfig``.

    Threads: callbacks only store; ``spin`` (in lockstep ``step``) does all the work.

    On error: a goal in another frame or far from any place is aborted with the reason. A stop that move_base gives up
    is sent again. Without a transform, the robot counts as where it was last, and takes no further places.
    """

    def __init__(self) -> None:
        self._config = config_from_mapping(CoordinatorNodeConfig, entry.parameters(), rospy.get_name())
        self._robot = self._config.robot or rospy.get_namespace().strip("/") or "robot"
        self._fleet = [name for name in self._config.fleet.split() if name != self._robot]
        self._base = robot_frame("base_link")
        self._lost = StandingWarning("the transform to map has come", _COMPLAIN_EVERY)
        self._listener = TransformListener()
        self._listener.listen("map", self._base)
        for name in self._fleet:
            self._listener.listen("map", f"{name}/base_link")
        self._maps: queue.SimpleQueue[GridMessage] = queue.SimpleQueue()
        self._reports: queue.SimpleQueue[ReportMessage] = queue.SimpleQueue()
        self._ends: queue.SimpleQueue[tuple[int, Outcome, str]] = queue.SimpleQueue()
        self._coordinator: Coordinator | None = None
        self._roadmap = Roadmap([], [])
        self._reporting: set[str] = set()
        self._stop: tuple[float, float] | None = None
        self._serial, self._retry_at = 0, math.inf
        self._stepped_at = -math.inf
        self._target: PoseStamped | None = None
        self._publisher = rospy.Publisher("/traffic/reports", ReportMessage, queue_size=5, tcp_nodelay=True)
        self._move_base = MoveBase(RospyHandle(), "move_base", self._note_end)
        self._server = actionlib.SimpleActionServer("traffic", MoveBaseAction, auto_start=False)
        self._server.start()
        rospy.Subscriber("/map", GridMessage, self._maps.put, queue_size=1)
        rospy.Subscriber("/traffic/reports", ReportMessage, self._reports.put, queue_size=100, tcp_nodelay=True)

    def _note_end(self, serial: int, outcome: Outcome, text: str) -> None:
        self._ends.put((serial, outcome, text))

    def spin(self) -> None:
        """Runs at a fixed wall-time period until shutdown."""
        while not entry.is_ending():
            begin = time.monotonic()
            self._use_maps()
            if self._coordinator is not None:
                self._work(self._coordinator, time.monotonic())
            entry.wait(max(0.01, begin + _PERIOD - time.monotonic()))

    def ready(self) -> bool:
        """Returns whether the map has arrived; called in the same thread as ``step``."""
        self._use_maps()
        return self._coordinator is not None

    def step(self) -> None:
        """Does the work of one period in lockstep, if a report is due."""
        now = rospy.get_time()
        if self._coordinator is not None and not 0.0 <= now - self._stepped_at < _PERIOD - 1.0e-6:
            self._stepped_at = now
            self._work(self._coordinator, now)

    def _use_maps(self) -> None:
        while not self._maps.empty():
            self._use_map(self._maps.get())

    def _use_map(self, message: OccupancyGrid) -> None:
        grid = grid_from_message(message)
        space = FreeSpace.of(grid.cells == FREE, grid.resolution, (grid.origin.x, grid.origin.y))
        roadmap = roadmap_from_space(space)
        if self._coordinator is None or roadmap.signature != self._roadmap.signature:
            self._roadmap = roadmap
            self._coordinator = Coordinator(self._robot, roadmap, self._config, self._fleet)
            rospy.loginfo("roadmap of %d places, signature %08x", len(roadmap.places), roadmap.signature)

    def _work(self, coordinator: Coordinator, now: float) -> None:
        while not self._reports.empty():
            report = report_from_message(self._reports.get(), len(self._roadmap.places))
            if report is not None:
                self._reporting.add(report.robot)
                coordinator.receive(report, now)
        position = self._position(self._base)
        if position is None:
            self._lost.warn(f"waiting for the transform from {self._base} to map")
            return
        self._lost.end()
        silent = (self._position(f"{name}/base_link") for name in self._fleet if name not in self._reporting)
        coordinator.set_obstacles([point for point in silent if point is not None])
        self._take_goal(coordinator)
        self._publisher.publish(message_from_report(coordinator.advance(position, now), rospy.Time.now()))
        self._note_ends(now)
        self._drive(coordinator.route, now)
        if coordinator.finished and self._server.is_active():
            self._server.set_succeeded(text="Goal reached.")
            self._end_goal(coordinator)

    def _position(self, frame: str) -> tuple[float, float] | None:
        try:
            pose = self._listener.lookup("map", frame).planar()
        except TransformError:
            return None
        return pose.x, pose.y

    def _take_goal(self, coordinator: Coordinator) -> None:
        if self._server.is_new_goal_available():
            self._target = target = self._server.accept_new_goal().target_pose
            point = (target.pose.position.x, target.pose.position.y)
            if stripped(target.header.frame_id) != "map":
                self._server.set_aborted(text=f"goals must be in frame map, not {target.header.frame_id!r}")
                self._end_goal(coordinator)
            elif not coordinator.set_waypoint(point, rospy.get_time()):
                self._server.set_aborted(text=f"no place of the roadmap is near ({point[0]:.2f}, {point[1]:.2f})")
                self._end_goal(coordinator)
        elif self._server.is_active() and self._server.is_preempt_requested():
            self._server.set_preempted()
            self._end_goal(coordinator)

    def _end_goal(self, coordinator: Coordinator) -> None:
        coordinator.set_waypoint(None, rospy.get_time())
        self._target = None

    def _note_ends(self, now: float) -> None:
        while not self._ends.empty():
            serial, outcome, text = self._ends.get()
            if serial != self._serial or self._stop is None:
                continue
            if outcome is not Outcome.REACHED or not self._is_at(self._stop):
                rospy.logwarn("move_base ended the way to (%.2f, %.2f): %s", *self._stop, text)
                self._retry_at = now + _RETRY

    def _drive(self, route: list[tuple[float, float]], now: float) -> None:
        """Sends move_base to the end of the route, if that has changed."""
        if not route or not self._move_base.present():
            return
        stop = route[-1]
        if self._stop is not None and math.dist(stop, self._stop) < _SAME and now < self._retry_at:
            return
        if self._stop is None and len(route) == 1 and self._is_at(stop):
            return
        self._stop, self._retry_at = stop, math.inf
        self._serial = self._move_base.send(MoveBaseGoal(self._pose_at(stop, route)))

    def _is_at(self, point: tuple[float, float]) -> bool:
        position = self._position(self._base)
        return position is not None and math.dist(position, point) <= self._config.reach

    def _pose_at(self, stop: tuple[float, float], route: list[tuple[float, float]]) -> PoseStamped:
        """Returns the goal's own pose at the goal; elsewhere a pose facing along the route."""
        target = self._target
        if target is not None and math.dist((target.pose.position.x, target.pose.position.y), stop) < _SAME:
            return target
        start = route[-2] if len(route) > 1 else self._position(self._base) or stop
        yaw = math.atan2(stop[1] - start[1], stop[0] - start[0])
        return stamped_from_pose(Pose(*stop, yaw), "map", rospy.Time.now())


def main() -> int:
    """Runs the node; returns the exit status."""
    return entry.run("coordinator", CoordinatorNode)
