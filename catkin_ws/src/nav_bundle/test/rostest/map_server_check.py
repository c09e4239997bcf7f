#!/usr/bin/env python3
"""map_server offers its map on all of its topics and services, and map_saver saves it."""

import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import rospy
import rostest
from drawn_room import grid_from_text
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap, LoadMap, LoadMapResponse

from nav_bundle.maps.map_file import read_map, write_map

CELLS = [100, 100, 100, 100, 100, 0, -1, 100, 100, 100, 100, 100]
TIMEOUT = 30.0


class MapServerCheck(unittest.TestCase):
    def test_the_map_is_latched(self) -> None:
        message = rospy.wait_for_message("map", OccupancyGrid, timeout=TIMEOUT)
        assert list(message.data) == CELLS
        assert message.header.frame_id == "map"
        assert rospy.wait_for_message("map_metadata", MapMetaData, timeout=TIMEOUT).width == 4

    def test_the_map_is_served(self) -> None:
        rospy.wait_for_service("static_map", timeout=TIMEOUT)
        served = rospy.ServiceProxy("static_map", GetMap)().map
        assert list(served.data) == CELLS
        assert (served.info.origin.position.x, served.info.origin.position.y) == (-1.0, -2.0)

    def test_the_map_is_saved(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            name = Path(folder, "saved")
            subprocess.run(
                ["rosrun", "nav_bundle", "map_saver", "-f", str(name)], check=True, timeout=TIMEOUT
            )
            assert read_map(name.with_suffix(".yaml")).cells.ravel().tolist() == CELLS

    def test_the_map_is_changed_and_a_bad_one_is_not_taken(self) -> None:
        rospy.wait_for_service("change_map", timeout=TIMEOUT)
        change = rospy.ServiceProxy("change_map", LoadMap)
        answer = change("/none.yaml")
        assert answer.result == LoadMapResponse.RESULT_MAP_DOES_NOT_EXIST
        with tempfile.TemporaryDirectory() as folder:
            path = write_map(grid_from_text(["#."]), Path(folder, "other"))[1]
            assert list(change(f"file://{path}").map.data) == [100, 0]
        here = Path(__file__).with_name("room.yaml")
        assert list(change(str(here)).map.data) == CELLS


if __name__ == "__main__":
    rospy.init_node("map_server_check")
    rostest.rosrun("nav_bundle", "map_server_check", MapServerCheck, sys.argv)
