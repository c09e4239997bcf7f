"""A synthetic robot in a drawn chamber (clock, odometry, scans), and a base class for tests of map -> odom."""

import math
import threading
import unittest
from collections.abc import Callable

import rospy
from drawn_room import CHAMBER, enlarged, ranges_at
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from nav_bundle.base.conversions import yaw_from_quaternion
from nav_bundle.base.pose import Pose
from nav_bundle.base.topics import TransformBroadcaster

START = Pose(1.5, 1.5, 0.0)
ODOM_START = Pose(-4.0, 3.0, 1.0)
LASER = Pose(0.1, 0.0, 0.0)
_MOST_TICKS = 600
"""A node that does not respond gets one tick per ``patience``."""


class RoomRobot:
    """Publishes the topics of pioneer3 in the chamber. Time advances only in ``tick``.

    Args:
        overrates: share by which the odometry overestimates distances (0.03: 3 % too long).
    """

    def __init__(self, overrates: float) -> None:
        self.grid = enlarged(CHAMBER, 16)
        self.pose, self.odom, self.time = START, ODOM_START, 100.0
        self._overrates = overrates
        self._clock = rospy.Publisher("/clock", Clock, queue_size=10)
        self._scan = rospy.Publisher("/pioneer3/base_scan", LaserScan, queue_size=10)
        self._tf = TransformBroadcaster()

    def tick(self, length: float = 0.0, turn: float = 0.0) -> None:
        """Advances time by 0.1 s, in which the robot drives ``length`` [m] and turns by ``turn`` [rad]."""
        self.time += 0.1
        self.pose = self.pose.compose(Pose(length, 0.0, turn))
        self.odom = self.odom.compose(Pose((1.0 + self._overrates) * length, 0.0, turn))
        stamp = rospy.Time.from_sec(self.time)
        self._clock.publish(Clock(stamp))
        # The scan is published first, so the node has to wait for the odometry of that stamp.
        self._scan.publish(self._measured(stamp))
        self._tf.send("pioneer3/base_link", "pioneer3/laser", stamp, LASER)
        self._tf.send("pioneer3/odom", "pioneer3/base_link", stamp, self.odom)

    def _measured(self, stamp: rospy.Time) -> LaserScan:
        scan = LaserScan(
            angle_min=-math.pi, angle_max=math.pi, angle_increment=math.tau / 179, range_max=30.0
        )
        scan.header.stamp, scan.header.frame_id = stamp, "pioneer3/laser"
        scan.ranges = ranges_at(self.grid, self.pose, LASER).tolist()
        return scan


class RoomTest(unittest.TestCase):
    """Base class of tests that drive ``robot`` and listen to the transform map -> pioneer3/odom."""

    robot: RoomRobot

    def setUp(self) -> None:
        self.arrived = threading.Condition()
        self.map_from_odom: Pose | None = None
        self.stamp = 0.0
        self.subscribers = [rospy.Subscriber("/tf", TFMessage, self.on_tf, queue_size=100)]

    def tearDown(self) -> None:
        for subscriber in self.subscribers:
            subscriber.unregister()

    def listen(self, topic: str, kind: type, name: str) -> None:
        """Keeps the newest message of ``topic`` in the attribute ``name``; it is None before the first message."""
        setattr(self, name, None)

        def keep(message: object) -> None:
            with self.arrived:
                setattr(self, name, message)
                self.arrived.notify_all()

        self.subscribers.append(rospy.Subscriber(topic, kind, keep))

    def on_tf(self, message: TFMessage) -> None:
        for edge in message.transforms:
            if (edge.header.frame_id, edge.child_frame_id) == ("map", "pioneer3/odom"):
                with self.arrived:
                    place, turn = edge.transform.translation, edge.transform.rotation
                    self.map_from_odom = Pose(place.x, place.y, yaw_from_quaternion(turn))
                    self.stamp = edge.header.stamp.to_sec()
                    self.arrived.notify_all()

    def answered(self) -> bool:
        """Returns whether the node has responded to the last tick."""
        raise NotImplementedError

    def drive_until(
        self,
        condition: Callable[[], bool],
        what: str,
        length: float = 0.0,
        turn: float = 0.0,
        patience: float = 0.1,
    ) -> None:
        """Ticks until ``condition`` holds. The robot moves in a tick only if the node responded to the last one.

        A slow node therefore sees the same motion as a fast one.

        Args:
            condition: checked whenever a message arrives.
            what: what the test waits for; used in the failure message.
            length: distance per tick [m].
            turn: rotation per tick [rad].
            patience: wall time [s] to wait per tick.
        """
        drives = True
        for _ in range(_MOST_TICKS):
            self.robot.tick(*((length, turn) if drives else (0.0, 0.0)))
            with self.arrived:
                if self.arrived.wait_for(condition, patience):
                    return
                drives = self.answered()
        self.fail(f"{what} did not come; last tf {self.map_from_odom} at {self.stamp}")
