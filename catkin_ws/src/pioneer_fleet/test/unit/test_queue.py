"""Reports of the waypoint client, as the fleet's tools read them."""

import pytest
from simple_navigation_goals.msg import WaypointQueue

from pioneer_fleet.conversions import queue_from_message
from pioneer_fleet.core.monitor import ClientState

STATES = {name: getattr(WaypointQueue, name) for name in ("IDLE", "WAITING_FOR_MOVE_BASE", "DRIVING", "RESTING")}


@pytest.mark.parametrize("name", STATES)
def test_every_state_of_a_waypoint_client_is_read(name: str) -> None:
    assert queue_from_message(WaypointQueue(state=STATES[name])).state is ClientState[name]
