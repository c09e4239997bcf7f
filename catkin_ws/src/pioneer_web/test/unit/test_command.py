"""Commands from a page are validated before anything is done."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pioneer_fleet.geometry import Pose
from pioneer_web.command.command import CommandError, command_from_text, formation

ROBOTS = ["pioneer1", "pioneer2"]


def command(**fields):
    return command_from_text(json.dumps(fields), ROBOTS)


def test_a_waypoint_has_a_place_and_a_heading():
    found = command(do="drive", robots=["pioneer2"], x=1, y=-2.5, yaw=7.0, append=True)
    assert found == (
        "drive",
        {"places": {"pioneer2": Pose(1.0, -2.5, math.remainder(7.0, math.tau))}, "append": True},
    )
    assert not command(do="drive", robots=["pioneer1"], x=0, y=0).arguments["append"]


def test_robots_sent_together_stand_side_by_side():
    places = formation(Pose(0.0, 0.0, math.pi / 2), ["a", "b", "c"])
    assert [round(place.x, 6) for place in places.values()] == [-1.2, 0.0, 1.2]


def test_stop_release_cancel_and_the_simulator():
    assert command(do="stop", robots=ROBOTS) == ("stop", {"robots": ROBOTS})
    assert command(do="release", robots=["pioneer1"]) == ("release", {"robots": ["pioneer1"]})
    assert command(do="cancel", robots=["pioneer1", "pioneer1"]) == (
        "cancel",
        {"robots": ["pioneer1"]},
    )
    assert command(do="simulate", action="pause") == ("simulate", {"action": "pause"})


@pytest.mark.parametrize(
    "text",
    ["", "[]", "null", '{"do": "fly"}', '{"do": "simulate", "action": "format"}', '{"do": "stop", "robots": []}',
     '{"do": "stop", "robots": ["/etc"]}', '{"do": "drive", "robots": ["pioneer1"], "x": NaN, "y": 0}',
     '{"do": "drive", "robots": ["pioneer1"], "x": true, "y": 0}',
     '{"do": "locate", "robots": ["pioneer1", "pioneer2"], "x": 0, "y": 0}',
     "[" * 9000, " " * 20000],
)  # fmt: skip
def test_what_is_not_understood_is_refused(text):
    with pytest.raises(CommandError):
        command_from_text(text, ROBOTS)


@given(
    st.text()
    | st.recursive(st.none() | st.booleans() | st.floats() | st.text(), st.lists).map(json.dumps)
)
def test_any_text_is_a_command_or_an_error(text):
    with pytest.raises(CommandError):
        command_from_text(text, ROBOTS)
