"""The data that a page gets about a robot, and the messages for its faults."""

import json
import math

import numpy as np
import pytest

from pioneer_fleet.geometry import Pose
from pioneer_web.state.picture import COSTS, MAP, png
from pioneer_web.state.robot import Image, Robot
from pioneer_web.state.station import Station
from pioneer_web.state.stream import Stream


@pytest.fixture
def robot():
    one = Robot(
        name="pioneer1",
        gateway="aadi1_gateway",
        correction=Pose(1.0, 0.0, math.pi / 2),
        odometry=Pose(2.0, 0.0),
    )
    one.add_odom(10.0, 5.0)
    one.add_scan(10.0, 5.0)
    return one


def test_its_place_is_the_correction_with_the_odometry(robot):
    assert robot.values("", 10.0)["pose"] == [1.0, 2.0, 1.571]


def test_lines_and_costs_in_odometrys_frame_are_moved_into_the_map(robot):
    robot.local_plan = "pioneer1/odom", [(1.0, 0.0)]
    robot.plan = "map", [(1.0, 0.0), (2.0, 0.5)]
    robot.costs = "pioneer1/odom", Image(Pose(0.0, 0.0), 3.0, 3.0, "")
    values = robot.values("", 10.0)
    assert values["local"] == [100, 100]
    assert values["plan"] == [100, 0, 200, 50]
    assert values["costs"]["at"] == [1.0, 0.0, 1.571]


def test_a_scan_is_drawn_from_where_it_was_taken(robot):
    robot.scan, robot.linear = (0.0, 0.1, [100]), 1.0
    robot.add_odom(10.0, 5.1)
    assert robot.values("", 10.0)["scan"][3] == [1.0, 1.9, 1.571]


@pytest.mark.parametrize(
    ("rule", "now", "words"),
    [
        (("active", ""), 10.0, ""),
        (
            ("no such gateway", "aadi1_gateway is not on the hub"),
            10.0,
            "aadi1_gateway: no such gateway, aadi1_gateway is",
        ),
        (("no publisher", "move_base publishes nothing yet"), 10.0, ""),
        (("active", ""), 13.0, "no odometry for 3 s"),
    ],
)
def test_what_is_wrong_is_said_in_words(robot, rule, now, words):
    fault = robot.fault({"aadi1_gateway": [rule]}, now)
    assert fault.startswith(words)
    assert bool(fault) == bool(words)


def test_a_robot_that_amcl_has_not_found_reports_it(robot):
    robot.correction = None
    assert robot.fault({}, 10.0) == "amcl has not localised it"


def test_a_page_gets_all_once_then_what_has_changed():
    stream = Stream()
    assert json.loads(stream.update({"a": 1, "b": [1, 2]})) == {"a": 1, "b": [1, 2]}
    assert stream.update({"a": 1, "b": [1, 2]}) == b""
    assert json.loads(stream.update({"a": 2})) == {"a": 2, "b": None}
    assert json.loads(stream.whole()) == {"a": 2}


def test_models_that_move_or_come_later_are_shown():
    station = Station()
    station.set_models([("wall", 0.0, 0.0), ("person", 1.0, 1.0)])
    station.set_models([("wall", 0.0, 0.0), ("person", 1.2, 1.0), ("box", 3.0, 3.0)])
    assert station.values(0.0)["actors"] == [["person", 1.2, 1.0], ["box", 3.0, 3.0]]


def test_a_new_line_of_the_log_takes_the_oldest_ones_place():
    station, stream = Station(), Stream()
    for number in range(201):
        station.add_log(1.0, 2, "aadi1", "/amcl", f"line {number}")
    stream.update(station.values(0.0))
    station.add_log(1.5, 8, "", "/gazebo", "the last")
    new = json.loads(stream.update(station.values(0.0)))
    assert new == {"log.1": [201, 1.5, "error", "", "/gazebo", "the last"]}


def test_maps_keep_their_known_cells_and_free_costs_are_transparent():
    from io import BytesIO

    from PIL import Image as Pictures

    cells = np.array([[0, 100], [-1, 50]], np.int8)
    picture = Pictures.open(BytesIO(png(cells, MAP))).convert("RGBA")
    assert picture.getpixel((0, 1)) == (255, 255, 255, 255)
    assert picture.getpixel((1, 1)) == (0, 0, 0, 255)
    assert picture.getpixel((0, 0))[:3] == (205, 205, 196)
    assert Pictures.open(BytesIO(png(cells, COSTS))).convert("RGBA").getpixel((0, 1))[3] == 0
