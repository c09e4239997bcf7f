"""The displays of an RViz configuration are found in its picture, and missing ones are named."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from pioneer_description.core.scene import (
    FREE,
    TOP_PLATE,
    Mark,
    SceneError,
    View,
    alone,
    marks_of,
    missing,
    view_of,
)

CONFIG = yaml.safe_load((Path(__file__).parents[2] / "rviz" / "multi_pioneer.rviz").read_text())
VIEW = View((0.0, 0.0), 20.0)
MARKS = [
    Mark("", "map", FREE),
    Mark("r1", "model", TOP_PLATE, 0.6),
    Mark("r1", "costs", None, 1.6),
    Mark("r1", "scan", (230, 40, 40)),
]


def picture():
    """Returns 20 x 20 m of free space with a robot at (5, 2): its top plate, costs beside it, and a distant scan."""
    image = np.full((400, 400, 3), FREE, np.uint8)
    image[156:164, 296:304] = TOP_PLATE
    image[150:156, 296:320] = (166, 165, 253)
    image[20:24, 20:24] = (230, 40, 40)
    return image


def lacking(image, position=None):
    return [str(mark) for mark in missing(image, VIEW, MARKS, {"r1": position} if position else {})]


def test_a_mark_knows_the_topic_that_leaves_it():
    topics = {str(mark): mark.topic for mark in marks_of(CONFIG)}
    assert topics["the map"] == "/map"
    assert topics["pioneer2's scan"] == "/pioneer2/base_scan"
    assert topics["pioneer2's model"] == ""


def test_the_shipped_configuration_shows_six_displays_of_five_robots_and_the_map():
    marks = marks_of(CONFIG)
    assert [str(mark) for mark in marks[:4]] == [
        "the map",
        "pioneer1's model",
        "pioneer1's scan",
        "pioneer1's local costmap",
    ]
    assert [str(mark) for mark in marks[4:6]] == ["pioneer1's global plan", "pioneer1's local plan"]
    assert [sum(mark.robot == f"pioneer{number}" for mark in marks) for number in range(1, 7)] == [
        5,
        5,
        5,
        5,
        5,
        0,
    ]
    assert view_of(CONFIG).scale > 0
    assert alone(CONFIG)["Panels"] == []
    assert alone(CONFIG)["Visualization Manager"]["Global Options"]["Frame Rate"] == 2
    assert CONFIG["Visualization Manager"]["Global Options"]["Frame Rate"] > 2


def test_each_robot_has_a_goal_and_an_initial_pose_tool():
    topics = [tool.get("Topic") for tool in CONFIG["Visualization Manager"]["Tools"]]
    for number in range(1, 6):
        assert {f"/pioneer{number}/map_goal_pose", f"/pioneer{number}/initialpose"} <= set(topics)


def test_a_picture_with_everything_lacks_nothing():
    assert lacking(picture(), (5.0, 2.0)) == []


@pytest.mark.parametrize(
    ("colour", "named"),
    [
        (TOP_PLATE, ["r1's model"]),
        ((166, 165, 253), ["r1's costs"]),
        ((230, 40, 40), ["r1's scan"]),
    ],
)
def test_what_is_painted_over_is_named(colour, named):
    image = picture()
    image[(image == colour).all(axis=-1)] = FREE
    assert lacking(image, (5.0, 2.0)) == named


@pytest.mark.parametrize(("off", "seen"), [(6, True), (-6, True), (7, False), (-7, False)])
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_a_colour_may_be_off_by_six_in_each_channel(channel, off, seen):
    image = picture()
    image[20:24, 20:24, channel] += np.uint8(off % 256)
    assert (lacking(image, (5.0, 2.0)) == []) is seen


def test_a_robot_that_is_drawn_elsewhere_or_has_no_position_is_not_seen():
    assert lacking(picture(), (-5.0, 2.0)) == ["r1's model", "r1's costs"]
    assert lacking(picture(), (500.0, 2.0)) == ["r1's model", "r1's costs"]
    assert lacking(picture()) == ["r1's model", "r1's costs"]


def test_a_grey_scene_has_no_costs():
    image = np.full((400, 400, 3), (238, 238, 236), np.uint8)
    assert lacking(image, (0.0, 0.0)) == ["the map", "r1's model", "r1's costs", "r1's scan"]


def test_two_displays_of_one_colour_are_refused():
    path = {"Class": "rviz/Path", "Name": "Plan", "Color": "1; 2; 3"}
    group = {"Class": "rviz/Group", "Name": "r1", "Displays": [path, path]}
    with pytest.raises(SceneError, match="colour of its own"):
        marks_of({"Visualization Manager": {"Displays": [{"Class": "rviz/Map"}, group]}})


def test_a_view_from_the_side_is_refused():
    with pytest.raises(SceneError, match="TopDownOrtho"):
        view_of({"Visualization Manager": {"Views": {"Current": {"Class": "rviz/Orbit"}}}})
