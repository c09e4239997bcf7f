"""Reports of the waypoint client, as the fleet's tools read them."""

import math

import pytest
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from nav_msgs.msg import Path
from simple_navigation_goals.msg import WaypointQueue

from pioneer_fleet.monitor.client import ClientState
from pioneer_fleet.monitor.conversions import (
    MessageError,
    points_from_path,
    pose_from_message,
    queue_from_message,
)

STATES = {
    name: getattr(WaypointQueue, name)
    for name in ("IDLE", "WAITING_FOR_MOVE_BASE", "DRIVING", "RESTING")
}


@pytest.mark.parametrize("name", STATES)
def test_every_state_of_a_waypoint_client_is_read(name: str) -> None:
    assert queue_from_message(WaypointQueue(state=STATES[name])).state is ClientState[name]


@pytest.mark.parametrize("number", [4, 100, 255])
def test_a_state_that_is_not_known_costs_only_the_state(number: int) -> None:
    queue = queue_from_message(WaypointQueue(state=number, reached=2))
    assert queue.state is ClientState.UNKNOWN
    assert queue.reached == 2


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300])
def test_poses_out_of_range_are_refused_and_points_left_out(value: float) -> None:
    with pytest.raises(MessageError, match="not finite or beyond"):
        pose_from_message(Pose(position=Point(x=value)))
    if not math.isfinite(value):
        with pytest.raises(MessageError):
            pose_from_message(Pose(orientation=Quaternion(z=value)))
    path = Path(poses=[PoseStamped(pose=Pose(position=Point(x=x))) for x in (1.0, value, 2.0)])
    assert points_from_path(path) == [(1.0, 0.0), (2.0, 0.0)]
