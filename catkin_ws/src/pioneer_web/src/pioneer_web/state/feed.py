"""Subscribes to the data that pages show, at the base station's master and only while pages are open."""

import functools
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import genpy
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gateway_msgs.msg import GatewayInfo
from gazebo_msgs.msg import ModelStates
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_bundle.msg import NavigationState
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rosgraph_msgs.msg import Clock, Log
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import BatteryState, LaserScan
from simple_navigation_goals.msg import WaypointQueue
from std_msgs.msg import Float64, Float64MultiArray
from tf2_msgs.msg import TFMessage

from pioneer_fleet.monitor.conversions import (
    MessageError,
    finite,
    frame_from_message,
    mount_of,
    pose_from_message,
    pose_from_transform,
    queue_from_message,
    state_from_message,
)
from pioneer_fleet.monitor.monitor import deviation_from_covariance
from pioneer_fleet.monitor.state import ACTIONS
from pioneer_fleet.tolerance import tolerant
from pioneer_web.state import conversions
from pioneer_web.state.picture import MAP, png
from pioneer_web.state.reach import Reach
from pioneer_web.state.robot import Robot
from pioneer_web.state.station import Station

BEAT = 0.2
"""Update period of pages [s]."""
COSTS = 5
"""Beats between two costmap images, which make up most of the traffic to pages."""
ROOM = 1 << 18
"""Receive buffer [bytes], larger than the data on a topic between two beats."""
_FROM_MAP = b"\x03\x00\x00\x00map"
"""A frame name in serialised form. Old nodes send it with a leading slash, so its length differs."""
_FROM_OLD_MAP = b"\x04\x00\x00\x00/map"


class Feed:
    """Keeps a `Station` up to date between `open` and `close`.

    Subscribes while open: /clock, /map, /tf, /diagnostics, /rosout_agg, /gateway/gateway_info, /gateway/rules,
    /ros2_door/topics, /gazebo/model_states, /gazebo/real_time_factor, /replay/position; for each robot its
    scan, odom, battery_state, amcl_pose, computer, rosout_agg, map_goal_client/queue, move_base/state, traffic/state,
    and move_base's plans and local costmap.

    Threads: rospy's, one per connection. Each handles only the newest message, then waits for the next beat while the
    kernel buffers: odometry at 100 Hz costs as much as at 5 Hz.

    On error: no errors of its own; missing data stays unknown.
    """

    def __init__(self, station: Station, on_queue: Callable[[Robot], None]) -> None:
        """Calls ``on_queue`` whenever a robot's waypoints have changed."""
        self.station, self.lock, self.map_png = station, threading.Lock(), b""
        self.reach: Reach | None = None  #: where robots can drive on the map; None without one
        self._on_queue_changed = on_queue
        self._frames: dict[str, Robot] = {}
        self._mounts: dict[str, str] = {}
        # One invalid transform does not cost the others of its message.
        self._take_transform = tolerant("/tf", self._on_transform)
        self._subscribers: list[rospy.Subscriber] = []
        self._beaten, self._beats = threading.Condition(), 0

    @property
    def is_open(self) -> bool:
        """Whether the topics are subscribed."""
        return bool(self._subscribers)

    def open(self) -> None:
        """Subscribes to all topics; no effect if already open.

        Raises:
            OSError: the master does not answer.
            rospy.ROSException: the master refuses.
        """
        if self.is_open:
            return
        self.station.watched_since = time.monotonic()
        listen = functools.partial(self._listen, beats=0)
        # The robots' poses first: with many robots, the last subscription is made a second later.
        listen("/tf", rospy.AnyMsg, self._on_tf, queue_size=None)
        listen("/map", numpy_msg(OccupancyGrid), self._on_map)
        self._listen("/clock", Clock, self._on_clock)
        self._listen_to(self.station.robots)
        listen("/gateway/rules", DiagnosticArray, self._on_rules)
        listen("/ros2_door/topics", DiagnosticArray, self._on_door)
        listen("/gateway/gateway_info", GatewayInfo, self._on_info)
        listen("/diagnostics", DiagnosticArray, self._on_diagnostics, queue_size=20)
        listen("/rosout_agg", Log, functools.partial(self._on_log, ""), queue_size=100)
        self._listen("/gazebo/real_time_factor", Float64, self._on_factor)
        self._listen("/gazebo/model_states", ModelStates, self._on_models)
        self._listen("/replay/position", Float64MultiArray, self._on_replay)

    def add(self, robots: Sequence[Robot]) -> None:
        """Adds robots; subscribes to their topics at once if the feed is open.

        Raises:
            OSError: the master does not answer; no robot was added.
        """
        if self.is_open:
            self._listen_to(robots)
        with self.lock:
            self.station.robots = [*self.station.robots, *robots]
            self._frames |= {f"{robot.name}/odom": robot for robot in robots}

    def _listen_to(self, robots: Sequence[Robot]) -> None:
        scans = sorted(
            topic for topic, kind in rospy.get_published_topics() if kind == "sensor_msgs/LaserScan"
        )

        def each(
            topic: str, kind: Any, callback: Callable[[Robot, Any], None], beats: int = 1
        ) -> None:
            for robot in robots:
                self._listen(
                    f"/{robot.name}/{topic}", kind, functools.partial(callback, robot), beats
                )

        each("odom", Odometry, self._on_odom)
        for robot in robots:
            # The scan topic has no fixed name.
            topic = next(
                (topic for topic in scans if topic.startswith(f"/{robot.name}/")),
                f"/{robot.name}/base_scan",
            )
            self._listen(topic, numpy_msg(LaserScan), functools.partial(self._on_scan, robot))
        each("map_goal_client/queue", WaypointQueue, self._on_queue, 0)
        for action in ACTIONS:
            on_state = functools.partial(self._on_state, action)
            each(f"{action}/state", NavigationState, on_state, 0)
        each("move_base/NavfnROS/plan", Path, self._on_plan)
        each("move_base/TrajectoryPlannerROS/local_plan", Path, self._on_local_plan)
        each("move_base/local_costmap/costmap", numpy_msg(OccupancyGrid), self._on_costs, COSTS)
        each("amcl_pose", PoseWithCovarianceStamped, self._on_estimate, 0)
        each("battery_state", BatteryState, self._on_battery)
        each("computer", DiagnosticStatus, self._on_computer, 0)
        for robot in robots:
            computer = robot.gateway.removesuffix("_gateway")
            log = functools.partial(self._on_log, computer)
            self._listen(f"/{robot.name}/rosout_agg", Log, log, beats=0, queue_size=100)

    def close(self) -> None:
        """Ends all subscriptions."""
        for subscriber in self._subscribers:
            subscriber.unregister()
        self._subscribers.clear()
        self.beat()

    def beat(self) -> None:
        """Starts the next beat: each topic's newest message is processed."""
        with self._beaten:
            self._beats += 1
            self._beaten.notify_all()

    def _listen(
        self,
        topic: str,
        kind: Any,
        callback: Callable[[Any], None],
        beats: int = 1,
        queue_size: int | None = 1,
    ) -> None:
        take = tolerant(topic, callback)

        def locked(message: Any) -> None:
            with self.lock:
                take(message)
            if beats:
                self._pause(beats)

        one = rospy.Subscriber(
            topic, kind, locked, queue_size=queue_size, buff_size=ROOM, tcp_nodelay=True
        )
        self._subscribers.append(one)

    def _pause(self, beats: int) -> None:
        with self._beaten:
            until = self._beats + beats
            self._beaten.wait_for(
                lambda: self._beats >= until or not self.is_open, 5 * beats * BEAT
            )

    def _on_tf(self, message: Any) -> None:
        """Extracts the robots' corrections; other transforms, mostly odometry and wheels, are not even decoded."""
        if _FROM_MAP not in message._buff and _FROM_OLD_MAP not in message._buff:
            return
        try:
            transforms = TFMessage().deserialize(message._buff).transforms
        except genpy.DeserializationError as error:
            raise MessageError(str(error)) from None
        for transform in transforms:
            self._take_transform(transform)

    def _on_transform(self, transform: Any) -> None:
        robot = self._frames.get(frame_from_message(transform.child_frame_id))
        if robot is not None and frame_from_message(transform.header.frame_id) == "map":
            robot.correction = pose_from_transform(transform.transform)

    def _on_map(self, message: Any) -> None:
        info = message.info
        cells = conversions.cells_from_grid(message)
        self.map_png = png(cells, MAP)
        origin = pose_from_message(info.origin)
        self.reach = Reach(cells, info.resolution, origin)
        corner = info.origin.position
        size = info.width * info.resolution, info.height * info.resolution
        self.station.set_map(corner.x, corner.y, *size)

    def _on_info(self, message: Any) -> None:
        self.station.hub = ", ".join(message.hub_names) if message.connected else ""
        self.station.gateway = message.name

    def _on_rules(self, message: Any) -> None:
        self.station.set_rules(
            {one.key: one.value for one in status.values} for status in message.status
        )

    def _on_door(self, message: Any) -> None:
        self.station.set_door(
            (status.name.removeprefix("ros2_door: "), status.message)
            for status in message.status
            if status.level != DiagnosticStatus.OK
        )

    def _on_diagnostics(self, message: Any) -> None:
        self.station.add_links(
            (status.name, {one.key: one.value for one in status.values})
            for status in message.status
        )

    def _on_log(self, computer: str, message: Any) -> None:
        self.station.add_log(
            message.header.stamp.to_sec(), message.level, computer, message.name, message.msg
        )

    def _on_clock(self, message: Any) -> None:
        self.station.tick(message.clock.to_sec(), time.monotonic())

    def _on_factor(self, message: Any) -> None:
        self.station.real_time_factor = round(message.data, 2)

    def _on_models(self, message: Any) -> None:
        self.station.set_models(
            (name, pose.position.x, pose.position.y)
            for name, pose in zip(message.name, message.pose, strict=True)
        )

    def _on_replay(self, message: Any) -> None:
        self.station.replay = [round(finite(value, "position"), 1) for value in message.data[:2]]

    def _on_odom(self, robot: Robot, message: Any) -> None:
        robot.add_odom(time.monotonic(), message.header.stamp.to_sec())
        robot.odometry = pose_from_message(message.pose.pose)
        robot.linear = finite(message.twist.twist.linear.x, "linear.x")
        robot.angular = finite(message.twist.twist.angular.z, "angular.z")

    def _on_scan(self, robot: Robot, message: Any) -> None:
        robot.add_scan(time.monotonic(), message.header.stamp.to_sec())
        robot.scan = conversions.scan_from_message(message)
        frame = message.header.frame_id
        if self._mounts.get(robot.name) != frame:
            self._mounts[robot.name] = frame
            own = f"/{robot.name}/robot_description"
            name = own if rospy.has_param(own) else "/robot_description"
            # There is none in a replay.
            if rospy.has_param(name):
                robot.mount = mount_of(rospy.get_param(name), frame.rpartition("/")[2])

    def _on_local_plan(self, robot: Robot, message: Any) -> None:
        robot.local_plan = conversions.line_from_path(message)

    def _on_plan(self, robot: Robot, message: Any) -> None:
        robot.plan = conversions.line_from_path(message)

    def _on_costs(self, robot: Robot, message: Any) -> None:
        robot.costs = conversions.costs_from_grid(message)

    def _on_battery(self, robot: Robot, message: Any) -> None:
        robot.battery = round(message.percentage, 2)

    def _on_computer(self, robot: Robot, message: Any) -> None:
        values = {one.key: one.value for one in message.values}
        processors = finite(float(values["processors"]), "processors")
        memory = finite(float(values["memory [byte]"]), "memory")
        robot.load = [round(processors, 2), round(memory / 2**20)]

    def _on_estimate(self, robot: Robot, message: Any) -> None:
        robot.deviation = deviation_from_covariance(message.pose.covariance)

    def _on_state(self, action: str, robot: Robot, message: Any) -> None:
        others = {
            other.name: other.place
            for other in self.station.robots
            if other is not robot and other.place is not None
        }
        robot.said[action] = state_from_message(message, others)

    def _on_queue(self, robot: Robot, message: Any) -> None:
        robot.queue = queue_from_message(message)
        robot.goals = conversions.goals_from_queue(message)
        if not robot.goals:
            robot.plan = robot.local_plan = ("", [])
        self._on_queue_changed(robot)
