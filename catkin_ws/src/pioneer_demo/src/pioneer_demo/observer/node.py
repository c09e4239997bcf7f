"""Observes the fleet and sends waypoints, as a node on the hub gateway's master."""

import functools
import threading
import time
from typing import Any

import rospy
from actionlib_msgs.msg import GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray
from gateway_msgs.msg import GatewayInfo, RemoteRule, RemoteRuleWithStatus
from geometry_msgs.msg import TransformStamped, Twist
from nav_bundle.msg import NavigationState
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rosgraph_msgs.msg import Clock
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan
from simple_navigation_goals.msg import WaypointQueue
from std_msgs.msg import Bool, Float64, UInt32
from tf2_msgs.msg import TFMessage

from pioneer_demo.observer import conversions
from pioneer_demo.observer.fleet import Fleet
from pioneer_demo.observer.recording import Recording
from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.scenario.floor import Floor
from pioneer_demo.scenario.option import OBSERVER
from pioneer_fleet.geometry import Pose
from pioneer_fleet.monitor.conversions import (
    frame_from_message,
    mount_of,
    points_from_path,
    pose_from_message,
    pose_from_transform,
    queue_from_message,
    state_from_message,
)
from pioneer_fleet.monitor.state import ACTIONS
from pioneer_fleet.tolerance import tolerant

_MAP, _ODOM, _BASE = "map", "odom", "base_link"


class ObserverNode:
    """Stores the newest messages of the fleet in a ``Fleet``, and sends waypoints.

    Subscribes:
        /clock, /gazebo/ready, /gazebo/real_time_factor, /tf, /gateway/gateway_info, /diagnostics, once /map;
        in each robot's namespace base_pose_ground_truth, collisions, map_goal_client/queue, move_base/state,
        traffic/state, move_base/status, move_base/NavfnROS/plan (the last five through the gateway), and for a video
        base_scan.

    Publishes:
        <robot>/map_goal (geometry_msgs/Twist) for each robot, forwarded to the robot's master by the gateway.

    Threads: rospy's callbacks write under ``lock``; readers hold it too.

    On error: no errors of its own; missing data stays unknown in the fleet.
    """

    def __init__(
        self, fleet: Fleet, lock: threading.Lock, recording: Recording | None = None
    ) -> None:
        """Subscribes to all topics, to scans only for a ``recording``; the caller initialises the node."""
        self._fleet, self._lock, self._recording = fleet, lock, recording
        self._mounts: dict[str, Pose] = {}
        self.moving_since: dict[str, float] = {}
        self.flips: dict[str, str] = {}
        self.floor: Floor | None = None
        self._frames = {f"{robot.name}/{_ODOM}": robot for robot in fleet.robots}
        self._bases = {f"{robot.name}/{_BASE}": robot for robot in fleet.robots}
        self._goals = {
            robot.name: rospy.Publisher(f"/{robot.name}/map_goal", Twist, queue_size=100)
            for robot in fleet.robots
        }
        # One invalid transform does not cost the others of its message.
        self._take_transform = tolerant("/tf", self._on_transform)
        self._subscribe("/clock", Clock, self._on_clock)
        self._subscribe("/gazebo/ready", Bool, self._on_ready)
        self._subscribe("/gazebo/real_time_factor", Float64, self._on_real_time_factor)
        self._subscribe("/gateway/gateway_info", GatewayInfo, self._on_gateway_info)
        self._subscribe("/tf", TFMessage, self._on_tf)
        self._subscribe("/diagnostics", DiagnosticArray, self._on_diagnostics)
        for robot in fleet.robots:
            self._subscribe_robot(robot)

    def read_map(self) -> None:
        """Requests the map once; ``floor`` is set when it arrives."""
        self._map = rospy.Subscriber("/map", numpy_msg(OccupancyGrid), self._on_map, queue_size=1)

    def can_be_sent(self, robot: RobotTrack) -> bool:
        """Returns whether the robot's waypoint client is connected through the gateways."""
        return bool(self._goals[robot.name].get_num_connections() > 0)

    def send(self, robot: RobotTrack, goal: Pose) -> None:
        """Sends one waypoint to a robot."""
        self._goals[robot.name].publish(conversions.twist_from_goal(goal))

    def waiting_flips(self) -> list[str]:
        """Returns topic and state of each of the observer's flips that is not accepted yet."""
        with self._lock:
            accepted = RemoteRuleWithStatus.ACCEPTED
            return [
                f"{rule}: {status}" for rule, status in self.flips.items() if status != accepted
            ]

    def _subscribe_robot(self, robot: RobotTrack) -> None:
        topics = {
            "base_pose_ground_truth": (Odometry, self._on_truth),
            "collisions": (UInt32, self._on_collisions),
            "map_goal_client/queue": (WaypointQueue, self._on_queue),
            **{
                f"{action}/state": (NavigationState, functools.partial(self._on_navigation, action))
                for action in ACTIONS
            },
            "move_base/status": (GoalStatusArray, self._on_status),
            "move_base/NavfnROS/plan": (Path, self._on_plan),
        }
        if self._recording is not None:
            topics["base_scan"] = (LaserScan, self._on_scan)
        for topic, (kind, callback) in topics.items():
            self._subscribe(f"/{robot.name}/{topic}", kind, functools.partial(callback, robot))

    def _subscribe(self, topic: str, kind: Any, callback: Any) -> None:
        rospy.Subscriber(
            topic, kind, tolerant(topic, self._locked), callback, queue_size=100, tcp_nodelay=True
        )

    def _locked(self, message: Any, callback: Any) -> None:
        with self._lock:
            callback(message)

    def _on_map(self, message: OccupancyGrid) -> None:
        self.floor = conversions.floor_from_grid(message)
        self._map.unregister()

    def _on_clock(self, message: Clock) -> None:
        self._fleet.simulator.time = message.clock.to_sec()

    def _on_ready(self, message: Bool) -> None:
        self._fleet.simulator.ready = message.data

    def _on_real_time_factor(self, message: Float64) -> None:
        self._fleet.simulator.real_time_factor = message.data

    def _on_gateway_info(self, message: GatewayInfo) -> None:
        ours = [
            remote for remote in message.flip_watchlist if remote.rule.node.strip("/") == OBSERVER
        ]
        known = {_key(flip.remote_rule): flip.status for flip in message.flipped_connections}
        self.flips = {_key(remote): known.get(_key(remote), "not connected") for remote in ours}

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for connection, messages, size in conversions.counters_from_diagnostics(message):
            self._fleet.traffic.add(connection, messages, size)

    def _on_tf(self, message: TFMessage) -> None:
        for transform in message.transforms:
            self._take_transform(transform)

    def _on_transform(self, transform: TransformStamped) -> None:
        parent = frame_from_message(transform.header.frame_id)
        child = frame_from_message(transform.child_frame_id)
        if parent == _MAP and child in self._frames:
            self._frames[child].add_correction(pose_from_transform(transform.transform))
        elif child in self._bases and parent in self._frames:
            stamp = transform.header.stamp.to_sec()
            self._bases[child].add_odometry(stamp, pose_from_transform(transform.transform))
            self._bases[child].monitor.add_odom(time.monotonic(), stamp)

    def _on_truth(self, robot: RobotTrack, message: Odometry) -> None:
        robot.add_truth(message.header.stamp.to_sec(), pose_from_message(message.pose.pose))
        robot.monitor.linear, robot.monitor.angular = conversions.speed_from_truth(message)
        self._fleet.note_distance(robot)
        if robot.first_motion is not None:
            self.moving_since.setdefault(robot.name, time.monotonic())
        if self._recording is not None and robot.pose is not None:
            self._recording.add_pose(robot.name, message.header.stamp.to_sec(), robot.pose)

    def _on_scan(self, robot: RobotTrack, message: LaserScan) -> None:
        assert self._recording is not None, "subscribed for a recording only"
        link = message.header.frame_id.rpartition("/")[2]
        if link not in self._mounts:
            own = f"/{robot.name}/robot_description"
            name = own if rospy.has_param(own) else "/robot_description"
            self._mounts[link] = mount_of(rospy.get_param(name), link)
        hits = conversions.hits_from_scan(message, self._mounts[link])
        self._recording.add_scan(robot.name, message.header.stamp.to_sec(), hits)

    def _on_collisions(self, robot: RobotTrack, message: UInt32) -> None:
        robot.collisions = message.data

    def _on_queue(self, robot: RobotTrack, message: WaypointQueue) -> None:
        robot.add_queue(queue_from_message(message))

    def _on_navigation(self, action: str, robot: RobotTrack, message: NavigationState) -> None:
        others = {
            other.name: other.pose
            for other in self._fleet.robots
            if other is not robot and other.pose is not None
        }
        robot.monitor.said[action] = state_from_message(message, others)

    def _on_status(self, robot: RobotTrack, message: GoalStatusArray) -> None:
        robot.status = conversions.status_from_message(message)

    def _on_plan(self, robot: RobotTrack, message: Path) -> None:
        points = points_from_path(message)
        robot.add_plan(points)
        if self._recording is not None:
            self._recording.add_plan(robot.name, self._fleet.simulator.time, points)


def _key(remote: RemoteRule) -> str:
    return f"{remote.rule.name} of {remote.gateway}"
