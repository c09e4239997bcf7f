#!/usr/bin/env python3
"""amcl tracks a robot in a map that another node offers only through the service ``static_map``."""

import sys

import numpy as np
import rospy
import rostest
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap, GetMapRequest, GetMapResponse
from room_robot import RoomRobot, RoomTest


class StaticMapCheck(RoomTest):
    @classmethod
    def setUpClass(cls) -> None:
        cls.robot = RoomRobot(0.02)
        cls.asked = 0
        rospy.Service("/static_map", GetMap, cls.answer)

    @classmethod
    def answer(cls, _: GetMapRequest) -> GetMapResponse:
        """Answers like a node without our message classes: the cells are a list of ints."""
        cls.asked += 1
        if cls.asked == 1:
            raise rospy.ServiceException("the map is still being read")
        grid = cls.robot.grid
        info = MapMetaData(resolution=grid.resolution, width=grid.cols, height=grid.rows)
        info.origin.orientation.w = 1.0
        message = OccupancyGrid(info=info, data=grid.cells.ravel().tolist())
        message.header.frame_id = "map"
        return GetMapResponse(message)

    def answered(self) -> bool:
        """Returns whether amcl has published tf for the robot's latest scan."""
        return abs(self.stamp - self.robot.time - 0.5) < 1e-6

    def test_the_robot_is_followed_in_the_map_of_the_service(self) -> None:
        self.drive_until(self.answered, "tf map to odom of the last scan")
        errors = []
        for _ in range(30):
            self.drive_until(self.answered, "tf of the last scan", 0.05)
            assert self.map_from_odom is not None
            errors.append(self.map_from_odom.compose(self.robot.odom).distance(self.robot.pose))
        assert np.mean(errors[10:]) < 0.05, errors
        assert self.asked == 2


if __name__ == "__main__":
    rospy.init_node("static_map_check")
    rostest.rosrun("nav_bundle", "static_map_check", StaticMapCheck, sys.argv)
