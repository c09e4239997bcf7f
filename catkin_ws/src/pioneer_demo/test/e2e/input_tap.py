"""Stands between a robot's computer and its gateway: forwards the robot's inputs, withholds them or spoils them."""

import copy
import logging
import math
import os
import subprocess
import time

from geometry_msgs.msg import Twist
from nav_msgs.msg import OccupancyGrid, Odometry
from rosgraph_msgs.msg import Clock, Log
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Empty, Header
from tf2_msgs.msg import TFMessage

from pioneer_harness.wait import wait_until
from pioneer_node.adapters.node_handle import NodeHandle
from tcpros.frame import LENGTH_SIZE
from tcpros.node_context import NodeContext
from tcpros.reactor import Reactor

COMMAND = 30.0
"""Time limit of one command [s]."""
SHIFTS = {"scans 0.6 s ahead": 0.6, "scans 5 s old": -5.0}
"""Faults that shift the scans' stamps [s]."""
WITHHELD = {
    "no scans": "scan",
    "no odometry": "odom",
    "no transforms of the robot": "tf",
    "no clock": "clock",
}
"""Faults that withhold an input."""


class InputTap:
    """Replaces the gateway's connections for a robot's scans, odometry, transforms and clock by its own.

    Args:
        base: URI of the base station's master.
        computer: URI of the master on the robot's computer.
        robot: name of the robot.
    """

    def __init__(self, base: str, computer: str, robot: str) -> None:
        self._computer = computer
        self._robot = robot
        self.fault = ""  #: what is wrong with the inputs now; empty for nothing
        self.speed = 0.0  #: the robot's true speed [m/s]
        self.turn = 0.0  #: its true yaw rate [rad/s]
        self.position = (0.0, 0.0)  #: its true position [m]
        self.stands_since: float | None = None  #: monotonic time [s]; None while it moves
        self.lines: list[str] = []  #: log lines of the nodes on the robot's computer
        logger = logging.getLogger("input_tap")
        self._reactor = Reactor(logger)
        self._there = self._node(base, logger)
        self._here = self._node(computer, logger)
        self._goals = self._here.advertise(f"/{robot}/map_goal", Twist)
        self._clear = self._here.advertise(f"/{robot}/map_goal_client/cancel", Empty)
        self._map = self._here.advertise("/map", OccupancyGrid)
        self._here.subscribe("/rosout", Log, lambda line, _: self.lines.append(line.msg))
        self._there.subscribe(f"/{robot}/base_pose_ground_truth", Odometry, self._note_truth)
        self._reactor.start()

    def _node(self, master: str, logger: logging.Logger) -> NodeHandle:
        context = NodeContext(self._reactor, master, "127.0.0.1", "127.0.0.1", logger)
        return NodeHandle(context, "/input_tap", {}, lambda reason: None, wall_time=True)

    def close(self) -> None:
        """Ends both nodes."""
        ended = []
        for node in (self._there, self._here):
            node.call(lambda node=node: node.close(lambda: ended.append(node)))
        wait_until(lambda: len(ended) == 2, "the end of the tap's nodes", COMMAND)
        self._reactor.stop()

    def take_over(self) -> None:
        """Cancels the gateway's rules for the inputs, and forwards these inputs instead."""
        for topic in ("base_scan", "odom"):
            self.change_rule("flip_remote_subscriber.py", self._robot, topic, "", "--cancel")
        for topic in ("tf", "clock"):
            self.change_rule("pull_hub_publisher.py", topic, "--cancel")
        self._there.call(self._forward_all)

    def change_rule(self, *command: str, master: str = "") -> None:
        """Runs a script of rocon_flip on the robot's computer, or on that with another ``master``."""
        environment = {
            **os.environ,
            "ROS_MASTER_URI": master or self._computer,
            "ROS_IP": "127.0.0.1",
            "ROBOT_NAME": self._robot,
        }
        subprocess.run(
            ["rosrun", "rocon_flip", *command],
            env=environment,
            check=True,
            timeout=COMMAND,
            stdout=subprocess.DEVNULL,
        )

    def send(self, x: float, y: float) -> None:
        """Sends the robot a waypoint."""
        goal = Twist()
        goal.linear.x = x
        goal.linear.y = y
        self._here.call(lambda: self._goals.publish(goal))

    def clear(self) -> None:
        """Drops the robot's waypoints."""
        self._here.call(lambda: self._clear.publish(Empty()))

    def is_connected(self) -> bool:
        """Returns whether the robot's waypoint client and its users of the map are connected."""
        return self._goals.has_subscribers and self._map.has_subscribers

    def publish_useless_map(self) -> None:
        """Publishes a map without cells."""
        self._here.call(lambda: self._map.publish(OccupancyGrid()))

    @property
    def moves(self) -> bool:
        """Whether the robot drives, or turns, faster than it could by coasting."""
        return abs(self.speed) > 0.2 or abs(self.turn) > 0.5

    def _forward_all(self) -> None:
        self._forward("scan", f"/{self._robot}/base_scan", LaserScan, self._spoilt_scan)
        self._forward("odom", f"/{self._robot}/odom", Odometry, self._spoilt_odometry)
        self._forward("tf", "/tf", TFMessage)
        self._forward("clock", "/clock", Clock)

    def _forward(self, name, topic, kind, spoilt=None) -> None:
        publisher = self._here.advertise(topic, kind)

        def take(data, _sender) -> None:
            if WITHHELD.get(self.fault) == name:
                return
            if spoilt is not None and self.fault:
                publisher.publish(spoilt(kind().deserialize(bytes(data))))
            else:
                publisher.send(len(data).to_bytes(LENGTH_SIZE, "little") + bytes(data))

        self._there.subscribe_serialised(topic, kind, take)

    def _spoilt_scan(self, scan: LaserScan) -> LaserScan:
        if self.fault in SHIFTS:
            stamp = copy.copy(scan.header.stamp)
            nanoseconds = stamp.to_nsec() + int(SHIFTS[self.fault] * 1.0e9)
            stamp.secs, stamp.nsecs = divmod(max(0, nanoseconds), 1_000_000_000)
            scan.header = Header(scan.header.seq, stamp, scan.header.frame_id)
        if self.fault == "scans in an unknown frame":
            scan.header.frame_id = "nowhere"
        if self.fault == "empty scans":
            scan.ranges = []
        if self.fault == "scans of NaN":
            scan.ranges = [math.nan] * len(scan.ranges)
        return scan

    def _spoilt_odometry(self, odometry: Odometry) -> Odometry:
        if self.fault == "odometry without numbers":
            odometry.twist.twist.linear.x = math.nan
        return odometry

    def _note_truth(self, truth: Odometry, _sender: str) -> None:
        velocity = truth.twist.twist
        self.position = (truth.pose.pose.position.x, truth.pose.pose.position.y)
        self.speed = math.hypot(velocity.linear.x, velocity.linear.y)
        self.turn = velocity.angular.z
        if self.speed > 0.02 or abs(self.turn) > 0.05:
            self.stands_since = None
        elif self.stands_since is None:
            self.stands_since = time.monotonic()
