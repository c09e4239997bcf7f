"""A page that is killed and started again holds the robots that were held."""

import json

import pytest
import rosgraph
from served import served
from websockets.sync.client import connect

from pioneer_harness.wait import wait_until

pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


def test_robots_are_held_after_a_restart_until_they_are_released(tmp_path):
    with served(tmp_path) as fleet:
        assert _answer(fleet, "stop", "pioneer2") == "pioneer2 stopped and held"
        wait_until(lambda: _kept(fleet) == ["pioneer2"], "the hold", 10)
        # A restarted master has no parameters.
        rosgraph.Master("/test", fleet.master.uri).deleteParam("/fleet_page/held")
        wait_until(lambda: _kept(fleet) == ["pioneer2"], "the hold at the master again", 30)
        fleet.restart()
        assert _held(fleet) == {"pioneer1": False, "pioneer2": True}
        assert "stopped; release first" in _answer(fleet, "drive", "pioneer2", x=0.0, y=0.0)
        assert _answer(fleet, "release", "pioneer2") == "pioneer2 released"
        wait_until(lambda: _kept(fleet) == [], "the release", 10)
        fleet.restart()
        assert _held(fleet) == {"pioneer1": False, "pioneer2": False}


def _kept(fleet):
    try:
        return fleet.master.get_param("/fleet_page/held")
    except rosgraph.MasterError:
        return None


def _live(fleet):
    url = fleet.url.replace("http", "ws") + "/live"
    return connect(
        url, additional_headers={"Cookie": fleet.login(fleet.token)}, max_size=None, open_timeout=30
    )


def _answer(fleet, do, robot, **fields):
    with _live(fleet) as socket:
        socket.send(json.dumps({"do": do, "robots": [robot], **fields}))
        while not isinstance(frame := socket.recv(30), str):
            pass
        return json.loads(frame)["answer"]["text"]


def _held(fleet):
    with _live(fleet) as socket:
        values = json.loads(socket.recv(30))
        return {name: values[f"{name}.row"]["held"] for name in ("pioneer1", "pioneer2")}
