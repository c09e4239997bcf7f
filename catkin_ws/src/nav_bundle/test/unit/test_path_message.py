"""Messages written from arrays have the same bytes as genpy's."""

import io
import math

import numpy as np
import pytest
import rospy
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlanResponse

from nav_bundle.costmap.conversions import GridUpdateMessage
from nav_bundle.planning.conversions import GetPlanArrayResponse, PathMessage


def read(kind, message):
    buffer = io.BytesIO()
    message.serialize(buffer)
    return kind().deserialize(buffer.getvalue())


def test_a_path_is_read_as_the_poses_it_was_made_from():
    track = np.array([[1.0, 2.0, 0.0], [3.0, 4.0, math.pi / 2]])
    path = read(Path, PathMessage(track, "/map", rospy.Time(3, 4)))
    assert (path.header.frame_id, path.header.stamp) == ("map", rospy.Time(3, 4))
    assert [(pose.pose.position.x, pose.pose.position.y) for pose in path.poses] == [
        (1.0, 2.0),
        (3.0, 4.0),
    ]
    assert {pose.header.frame_id for pose in path.poses} == {"map"}
    assert path.poses[1].pose.orientation.z == pytest.approx(math.sin(math.pi / 4))


def test_a_plan_response_is_read_as_the_path_it_holds():
    path = PathMessage(np.array([[1.0, 2.0, 0.0], [3.0, 4.0, 0.5]]), "map", rospy.Time(3, 4))
    assert read(GetPlanResponse, GetPlanArrayResponse(path)).plan == read(Path, path)


def test_an_empty_path_is_one():
    assert read(Path, PathMessage(np.empty((0, 3)), "map", rospy.Time())).poses == []


def test_a_grid_update_is_read_as_it_was_written():
    update = GridUpdateMessage(x=1, y=2, width=3, height=1, data=np.array([-1, 0, 100], np.int8))
    assert tuple(read(OccupancyGridUpdate, update).data) == (-1, 0, 100)
