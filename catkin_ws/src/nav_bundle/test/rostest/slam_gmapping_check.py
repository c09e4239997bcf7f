#!/usr/bin/env python3
"""slam_gmapping draws a room from synthetic scans and odometry: map, metadata, entropy, service, tf."""

import math
import sys

import rospy
import rostest
from nav_msgs.msg import MapMetaData
from room_robot import ODOM_START, START, RoomRobot, RoomTest
from std_msgs.msg import Float64

from nav_bundle.conversions import GetMapArray, GridMessage, grid_from_message
from nav_bundle.core.map_quality import agreement

TF_DELAY = 0.25


class SlamGmappingCheck(RoomTest):
    map: GridMessage | None
    metadata: MapMetaData | None
    entropy: Float64 | None

    def setUp(self) -> None:
        super().setUp()
        self.robot = RoomRobot(0.03)
        self.listen("/pioneer3/map", GridMessage, "map")
        self.listen("/pioneer3/map_metadata", MapMetaData, "metadata")
        self.listen("/pioneer3/slam_gmapping/entropy", Float64, "entropy")

    def answered(self) -> bool:
        """Tells whether tf has been sent since the last tick, stamped ahead by tf_delay."""
        return self.stamp >= self.robot.time + TF_DELAY - 1e-6

    def test_the_room_is_drawn(self) -> None:
        map_from_room = ODOM_START.compose(START.inverse())
        self.drive_until(lambda: self.map is not None, "a first map")
        for turn in ([0.0] * 60 + [math.pi / 20] * 10) * 2 + [0.0] * 50:
            self.drive_until(
                self.answered, "tf of the last tick", 0.0 if turn else 0.05 if self.robot.time < 108 else 0.03, turn
            )
        first = self.map
        self.drive_until(lambda: self.map is not first, "a newer map", 0.0, 0.1)
        self.drive_until(self.answered, "tf of the last tick")

        assert self.map_from_odom is not None
        found = map_from_room.inverse().compose(self.map_from_odom.compose(self.robot.odom))
        assert found.distance(self.robot.pose) < 0.08, (found, self.robot.pose)

        assert self.map is not None
        assert self.metadata is not None
        assert self.entropy is not None
        assert self.map.header.frame_id == "map"
        assert (self.map.info.width, self.map.info.height) == (480, 480)
        assert (self.metadata.width, self.metadata.origin.position.x) == (480, -12.0)
        assert 0.0 <= self.entropy.data <= math.log(30) + 1e-6
        quality = agreement(grid_from_message(self.map), self.robot.grid, map_from_room.inverse())
        assert quality > 0.9, quality
        served = rospy.ServiceProxy("/pioneer3/dynamic_map", GetMapArray)().map
        assert len(served.data) == 480 * 480


if __name__ == "__main__":
    rospy.init_node("slam_gmapping_check", disable_rostime=True)
    rostest.rosrun("nav_bundle", "slam_gmapping_check", SlamGmappingCheck, sys.argv)
