#!/usr/bin/env python3
"""slam_gmapping draws a room from synthetic scans and odometry: map, metadata, entropy, service, tf."""

import math
import sys
import threading
import unittest
from collections.abc import Callable

import numpy as np
import rospy
import rostest
from nav_msgs.msg import MapMetaData
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Float64
from tf2_msgs.msg import TFMessage

from nav_bundle import _likelihood
from nav_bundle.conversions import GetMapArray, GridMessage, grid_from_message, yaw_from_quaternion
from nav_bundle.core.grid import Grid, grid_from_text
from nav_bundle.core.map_quality import agreement
from nav_bundle.core.pose import Pose
from nav_bundle.core.sensor import placement
from nav_bundle.nodes.transform import TransformBroadcaster

ROOM = ["#########", "#.......#", "#..#....#", "#.......#", "#.....###", "#.......#", "#########"]
START = Pose(1.5, 1.5, 0.0)
ODOM_START = Pose(-4.0, 3.0, 1.0)
TF_DELAY = 0.25


def room() -> Grid:
    drawn = grid_from_text(ROOM)
    return Grid(0.05, Pose(), np.ascontiguousarray(np.kron(drawn.cells, np.ones((16, 16), np.int8))))


class SlamGmappingCheck(unittest.TestCase):
    def setUp(self) -> None:
        self.grid, self.pose, self.odom, self.time = room(), START, ODOM_START, 100.0
        self.arrived = threading.Condition()
        self.map: GridMessage | None = None
        self.entropy: Float64 | None = None
        self.metadata: MapMetaData | None = None
        self.map_from_odom: Pose | None = None
        self.stamp = 0.0
        self.clock = rospy.Publisher("/clock", Clock, queue_size=10)
        self.scan = rospy.Publisher("/pioneer3/base_scan", LaserScan, queue_size=10)
        self.tf = TransformBroadcaster()
        rospy.Subscriber("/tf", TFMessage, self.on_tf, queue_size=100)
        rospy.Subscriber("/pioneer3/map", GridMessage, self.store("map"))
        rospy.Subscriber("/pioneer3/map_metadata", MapMetaData, self.store("metadata"))
        rospy.Subscriber("/pioneer3/slam_gmapping/entropy", Float64, self.store("entropy"))

    def store(self, name: str) -> Callable[[object], None]:
        def keep(message: object) -> None:
            with self.arrived:
                setattr(self, name, message)
                self.arrived.notify_all()

        return keep

    def on_tf(self, message: TFMessage) -> None:
        for edge in message.transforms:
            if (edge.header.frame_id, edge.child_frame_id) == ("map", "pioneer3/odom"):
                with self.arrived:
                    place = edge.transform.translation
                    self.map_from_odom = Pose(place.x, place.y, yaw_from_quaternion(edge.transform.rotation))
                    self.stamp = edge.header.stamp.to_sec()
                    self.arrived.notify_all()

    def tick(self, length: float, turn: float) -> None:
        """Lets 0.1 s pass, in which the robot drives; its odometry overrates distances by 3 %."""
        self.time += 0.1
        self.pose = self.pose.compose(Pose(length, 0.0, turn))
        self.odom = self.odom.compose(Pose(1.03 * length, 0.0, turn))
        stamp = rospy.Time.from_sec(self.time)
        self.clock.publish(Clock(stamp))
        # The scan goes out first: the node has to wait for the odometry of its stamp.
        self.scan.publish(self.measured(stamp))
        self.tf.send("pioneer3/base_link", "pioneer3/laser", stamp, Pose(0.1, 0.0, 0.0))
        self.tf.send("pioneer3/odom", "pioneer3/base_link", stamp, self.odom)

    def measured(self, stamp: rospy.Time) -> LaserScan:
        scan = LaserScan(angle_min=-math.pi, angle_max=math.pi, angle_increment=math.tau / 179, range_max=30.0)
        scan.header.stamp, scan.header.frame_id = stamp, "pioneer3/laser"
        ranges = np.empty((1, 180))
        poses = np.array([[self.pose.x, self.pose.y, self.pose.yaw]])
        bearings = scan.angle_min + scan.angle_increment * np.arange(180)
        laser = np.array([0.1, 0.0, 0.0])
        _likelihood.expected_ranges(poses, laser, bearings, self.grid.cells, placement(self.grid), 30.0, ranges)
        scan.ranges = ranges[0].tolist()
        return scan

    def drive_until(self, condition: Callable[[], bool], what: str, length: float = 0.0, turn: float = 0.0) -> None:
        """Ticks, each time as soon as the condition may hold, until it does."""
        for _ in range(150):
            self.tick(length, turn)
            with self.arrived:
                if self.arrived.wait_for(condition, timeout=0.2):
                    return
        self.fail(f"{what} did not come; last tf {self.map_from_odom} at {self.stamp}")

    def answered(self) -> bool:
        """Tells whether tf has been sent since the last tick, stamped ahead by tf_delay."""
        return self.stamp >= self.time + TF_DELAY - 1e-6

    def test_the_room_is_drawn(self) -> None:
        map_from_room = ODOM_START.compose(START.inverse())
        self.drive_until(lambda: self.map is not None, "a first map")
        for turn in ([0.0] * 60 + [math.pi / 20] * 10) * 2 + [0.0] * 50:
            self.drive_until(
                self.answered, "tf of the last tick", 0.0 if turn else 0.05 if self.time < 108 else 0.03, turn
            )
        first = self.map
        self.drive_until(lambda: self.map is not first, "a newer map", 0.0, 0.1)
        self.drive_until(self.answered, "tf of the last tick")

        assert self.map_from_odom is not None
        found = map_from_room.inverse().compose(self.map_from_odom.compose(self.odom))
        assert found.distance(self.pose) < 0.08, (found, self.pose)

        assert self.map is not None
        assert self.metadata is not None
        assert self.entropy is not None
        assert self.map.header.frame_id == "map"
        assert (self.map.info.width, self.map.info.height) == (480, 480)
        assert (self.metadata.width, self.metadata.origin.position.x) == (480, -12.0)
        assert 0.0 <= self.entropy.data <= math.log(30) + 1e-6
        quality = agreement(grid_from_message(self.map), self.grid, map_from_room.inverse())
        assert quality > 0.9, quality
        served = rospy.ServiceProxy("/pioneer3/dynamic_map", GetMapArray)().map
        assert len(served.data) == 480 * 480


if __name__ == "__main__":
    rospy.init_node("slam_gmapping_check", disable_rostime=True)
    rostest.rosrun("nav_bundle", "slam_gmapping_check", SlamGmappingCheck, sys.argv)
