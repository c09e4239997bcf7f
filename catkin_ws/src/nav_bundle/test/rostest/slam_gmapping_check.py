#!/usr/bin/env python3
"""slam_gmapping maps a room from synthetic scans and odometry: map, metadata, entropy, service, tf."""

import math
import sys

import rospy
import rostest
from nav_msgs.msg import MapMetaData
from room_robot import ODOM_START, START, RoomRobot, RoomTest
from std_msgs.msg import Float64

from nav_bundle.maps.conversions import GetMapArray, GridMessage, grid_from_message
from nav_bundle.maps.map_quality import agreement

TF_DELAY = 0.25
STEP, TURN = 0.3, math.pi / 10
"""Movement after which a scan is used [m, rad]; each used scan yields a map (slam_gmapping.test)."""


class SlamGmappingCheck(RoomTest):
    map: GridMessage | None
    before: GridMessage | None = None
    metadata: MapMetaData | None
    entropy: Float64 | None

    def setUp(self) -> None:
        super().setUp()
        self.robot = RoomRobot(0.03)
        self.listen("/pioneer3/map", GridMessage, "map")
        self.listen("/pioneer3/map_metadata", MapMetaData, "metadata")
        self.listen("/pioneer3/slam_gmapping/entropy", Float64, "entropy")

    def answered(self) -> bool:
        """Returns whether the last step has its map, followed by tf stamped ahead by tf_delay.

        Tf alone does not suffice: a node that skips most scans still publishes it in time.
        """
        return self.map is not self.before and self.stamp >= self.robot.time + TF_DELAY - 1e-6

    def drive(self, length: float, turn: float) -> None:
        """Drives one step and waits for its map.

        A step has exactly one scan: the filter draws noise for each scan, so one more or less changes the map.
        """
        self.before = self.map
        self.drive_until(self.answered, "map and tf of the step", length, turn, patience=5.0)

    def test_the_room_is_drawn(self) -> None:
        map_from_room = ODOM_START.compose(START.inverse())
        self.drive_until(lambda: self.map is not None, "a first map")
        turned = [(0.0, TURN)] * 5
        for length, turn in (
            [(STEP, 0.0)] * 10 + turned + [(STEP, 0.0)] * 5 + turned + [(STEP, 0.0)] * 5
        ):
            self.drive(length, turn)
        self.drive(0.0, TURN)

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
