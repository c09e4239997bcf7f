"""``report``: prints the state of this computer as lines of JSON, until the requested stage or the timeout."""

import argparse
import functools
import json
import math
import os
import re
import sys
import threading
import time
from typing import Any

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from gateway_msgs.msg import GatewayInfo
from gazebo_msgs.msg import ModelStates
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from nav_bundle.msg import NavigationState
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from simple_navigation_goals.msg import WaypointQueue
from std_msgs.msg import Float64

from pioneer_fleet.monitor.conversions import queue_from_message, state_from_message
from pioneer_fleet.monitor.monitor import deviation_from_covariance
from pioneer_fleet.monitor.report import Report, Stage, states_of
from pioneer_fleet.monitor.state import ACTIONS
from pioneer_fleet.monitor.tour import Place, places_from_mapping, tour
from pioneer_fleet.tolerance import tolerant
from pioneer_launch.door import patch_observer
from pioneer_node.nodes.entry import parameters_below

MASTER_LOOK = 0.2
"""Poll interval for a master that is not up yet [s]: it does not announce its start."""
QUEUE = 1000
"""Subscriber queue size: gap detection must not lose any message."""
LINE_EVERY = 0.5
"""Minimum interval between lines, except before the last [s]."""


class ReportNode:
    """Subscribes to this computer's gateway and robot, or simulator, and updates one `Report`.

    Subscribes: /gateway/gateway_info, /gateway/rules; for a robot its odom, base_scan, amcl_pose,
    map_goal_client/queue, move_base/state and traffic/state; on the base station /gazebo/real_time_factor and
    /gazebo/model_states.
    Publishes: NAME/map_goal, for the robot's goals.
    Threads: callbacks write under a lock and wake the main thread, which prints.
    """

    def __init__(self, report: Report, places: list[Place], waypoints: int, robots: int) -> None:
        """Sends the robot to ``places``; else, if it has had no goals, to so many ``waypoints`` of a fleet's tour."""
        self._report, self._places, self._waypoints, self._robots = (
            report,
            places,
            waypoints,
            robots,
        )
        self._sent, self._due = False, 0
        self._changed = threading.Condition()
        self._listen("/gateway/gateway_info", GatewayInfo, self._on_info)
        self._listen("/gateway/rules", DiagnosticArray, self._on_rules)
        self._goals: rospy.Publisher | None = None
        if report.robot:
            self._goals = rospy.Publisher(f"/{report.robot}/map_goal", Twist, queue_size=20)
            self._listen(f"/{report.robot}/odom", Odometry, self._on_odom)
            self._listen(f"/{report.robot}/base_scan", LaserScan, self._on_scan)
            self._listen(f"/{report.robot}/amcl_pose", PoseWithCovarianceStamped, self._on_pose)
            self._listen(f"/{report.robot}/map_goal_client/queue", WaypointQueue, self._on_queue)
            for action in ACTIONS:
                on_state = functools.partial(self._on_state, action)
                self._listen(f"/{report.robot}/{action}/state", NavigationState, on_state)
        else:
            self._listen("/gazebo/real_time_factor", Float64, self._on_factor)
            self._listen("/gazebo/model_states", ModelStates, self._on_models)

    def follow(self, until: Stage, arrived: int, timeout: float, settled: bool) -> bool:
        """Prints a line on each relevant change; returns whether the goal was reached before the time-out.

        The goal: stage ``until`` is reached, the places and ``arrived`` waypoints are processed, none waits.
        ``settled`` prints only the last line.
        """
        deadline, printed, last = time.monotonic() + timeout, "", -math.inf
        with self._changed:
            while not rospy.is_shutdown():
                now = time.monotonic()
                self._drive()
                done, late = (
                    self._report.has_come(until) and self._has_arrived(arrived),
                    now >= deadline,
                )
                key = f"{self._report.stage}{self._report.lacks}"
                if done or late or (not settled and key != printed and now - last >= LINE_EVERY):
                    _tell(self._report.as_json(now))
                    printed, last = key, now
                if done or late:
                    return done
                self._changed.wait(min(deadline - now, LINE_EVERY))
        return False

    def _has_arrived(self, count: int) -> bool:
        under_way = bool(self._places) and not self._sent
        return not under_way and self._report.has_arrived(max(count, self._due))

    def _drive(self) -> None:
        """Sends the robot's goals once the robot is ready for them."""
        if self._sent or self._report.stage < Stage.READY or self._goals is None:
            return
        if not self._goals.get_num_connections():
            return
        self._sent, places = True, self._places
        received = self._report.queue.received if self._report.queue else 0
        if places:
            self._due = received + len(places)
        elif self._waypoints and not received:
            places = self._tour()
        for x, y, heading in places:
            goal = Twist()
            goal.linear.x, goal.linear.y, goal.angular.z = x, y, math.degrees(heading)
            self._goals.publish(goal)

    def _tour(self) -> list[Place]:
        number = int(re.sub(r"\D", "", self._report.robot) or 1)
        places = places_from_mapping(parameters_below("/"))
        return tour(places, number, self._robots, self._waypoints) if places else []

    def _key(self) -> tuple[Stage, int]:
        """Returns the state whose changes wake the main thread."""
        return self._report.stage, self._report.queue.waiting if self._report.queue else 0

    def _listen(self, topic: str, kind: Any, callback: Any) -> None:
        def locked(message: Any) -> None:
            with self._changed:
                before = self._key()
                callback(message)
                if self._key() != before:
                    self._changed.notify()

        rospy.Subscriber(topic, kind, tolerant(topic, locked), queue_size=QUEUE, tcp_nodelay=True)

    def _on_info(self, message: GatewayInfo) -> None:
        self._report.gateway = message.name
        self._report.hub = message.hub_names[0] if message.connected and message.hub_names else ""

    def _on_rules(self, message: DiagnosticArray) -> None:
        self._report.rules = states_of(
            {one.key: one.value for one in status.values} for status in message.status
        )

    def _on_odom(self, message: Odometry) -> None:
        self._report.add_odom(time.monotonic(), message.header.stamp.to_sec())
        self._report.linear, self._report.angular = (
            message.twist.twist.linear.x,
            message.twist.twist.angular.z,
        )

    def _on_scan(self, message: LaserScan) -> None:
        self._report.add_scan(time.monotonic(), message.header.stamp.to_sec())

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        pose = message.pose.pose
        heading = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        self._report.pose = (pose.position.x, pose.position.y, heading)
        self._report.deviation = deviation_from_covariance(message.pose.covariance)

    def _on_queue(self, message: WaypointQueue) -> None:
        self._report.queue = queue_from_message(message)

    def _on_state(self, action: str, message: NavigationState) -> None:
        # Where the other robots are is not known on this robot's computer.
        self._report.said[action] = state_from_message(message, {})

    def _on_factor(self, message: Float64) -> None:
        self._report.real_time_factor = round(message.data, 2)

    def _on_models(self, message: ModelStates) -> None:
        self._report.models = tuple(name for name in message.name if name.startswith("pioneer"))


def _place(text: str) -> Place:
    try:
        x, y, *heading = (float(word) for word in text.split(","))
        return (x, y, heading[0] if heading else 0.0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"a place is X,Y or X,Y,HEADING, not {text!r}") from None


def _tell(line: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


def main() -> int:
    """Runs the command; the exit status is 0 if the goal was reached."""
    parser = argparse.ArgumentParser("report", description=(__doc__ or "").strip())
    stages = [stage.name.lower() for stage in Stage]
    parser.add_argument(
        "--robot", default="", help="robot driven from this computer; none on the base station"
    )
    parser.add_argument(
        "--until", choices=stages, default=stages[-1], help="end once this stage is reached"
    )
    parser.add_argument(
        "--arrived", type=int, default=0, help="and so many waypoints have ended, with none queued"
    )
    parser.add_argument(
        "--to", type=_place, action="append", default=[], metavar="X,Y[,HEADING]",
        help="send the robot there [m, rad] and wait until that waypoint has ended; repeat for several places",
    )  # fmt: skip
    parser.add_argument(
        "--timeout", type=float, default=2.0, help="end after so many seconds at the latest"
    )
    parser.add_argument("--settled", action="store_true", help="print the last line only")
    parser.add_argument(
        "--waypoints", type=int, default=0, help="send a robot without waypoints to so many places"
    )
    parser.add_argument(
        "--robots", type=int, default=1, help="robots of the fleet, which share the places"
    )
    options = parser.parse_args()
    report = Report(os.environ.get("HOSTNAME", ""), options.robot)
    deadline = time.monotonic() + options.timeout
    if not _master_answers(deadline):
        _tell({**report.as_json(time.monotonic()), "lacks": "no ROS master on this computer"})
        return 1
    patch_observer()
    rospy.init_node("fleet_report", anonymous=True, disable_rostime=True, log_level=rospy.ERROR)
    node = ReportNode(report, options.to, options.waypoints, options.robots)
    left = max(0.1, deadline - time.monotonic())
    return (
        0
        if node.follow(Stage[options.until.upper()], options.arrived, left, options.settled)
        else 1
    )


def _master_answers(deadline: float) -> bool:
    """Waits for this computer's master; returns False if it is not up by ``deadline`` (monotonic [s])."""
    master, wait = rosgraph.Master("/fleet_report"), threading.Event()
    while time.monotonic() < deadline:
        try:
            master.getPid()
        except (OSError, rosgraph.MasterException):
            wait.wait(MASTER_LOOK)
            continue
        return True
    return False
