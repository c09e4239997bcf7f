"""A waypoint is finite, and its heading survives conversion to messages and back."""

import math

import pytest
from genpy import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, Vector3
from std_msgs.msg import Header

from simple_navigation_goals.conversions import (
    pose_from_waypoint,
    waypoint_from_pose,
    waypoint_from_twist,
)
from simple_navigation_goals.waypoint import Waypoint, WaypointError


def test_the_heading_of_a_twist_is_in_degrees() -> None:
    waypoint = waypoint_from_twist(Twist(Vector3(1.0, 2.0, 7.0), Vector3(0.0, 0.0, 90.0)), "map")
    assert waypoint == Waypoint(1.0, 2.0, math.pi / 2.0, "map")


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["x", "y", "yaw"])
def test_a_number_that_is_not_finite_is_refused_by_name(name: str, bad: float) -> None:
    values = {"x": 1.0, "y": 2.0, "yaw": 0.0, name: bad}
    with pytest.raises(WaypointError, match=f"{name} is .*finite"):
        Waypoint(**values, frame="map")


@pytest.mark.parametrize(
    "turn", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, math.nan, 1.0), (math.inf, 0.0, 0.0, 0.0)]
)
def test_an_orientation_that_is_no_rotation_is_refused(turn: tuple[float, ...]) -> None:
    with pytest.raises(WaypointError, match="no rotation"):
        waypoint_from_pose(PoseStamped(pose=Pose(Point(1.0, 2.0, 0.0), Quaternion(*turn))), "map")


@pytest.mark.parametrize(
    ("given", "expected"), [("", "map"), ("/map", "map"), ("pioneer1/odom", "pioneer1/odom")]
)
def test_a_pose_keeps_its_frame_without_slash_or_takes_the_clients(
    given: str, expected: str
) -> None:
    pose = PoseStamped(Header(0, Time(), given), Pose(Point(), Quaternion(0.0, 0.0, 0.0, 1.0)))
    assert waypoint_from_pose(pose, "map").frame == expected


@pytest.mark.parametrize("degrees", [-179.0, -90.0, 0.0, 45.0, 180.0])
def test_a_waypoint_survives_the_way_through_a_pose(degrees: float) -> None:
    waypoint = Waypoint(-3.0, 4.5, math.radians(degrees), "map")
    again = waypoint_from_pose(pose_from_waypoint(waypoint, Time()), "elsewhere")
    assert (again.x, again.y, again.frame) == (waypoint.x, waypoint.y, waypoint.frame)
    assert math.remainder(again.yaw - waypoint.yaw, math.tau) == pytest.approx(0.0, abs=1e-12)
