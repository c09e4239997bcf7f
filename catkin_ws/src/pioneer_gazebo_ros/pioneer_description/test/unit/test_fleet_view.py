"""A fleet's RViz configuration shows the existing robots, each in its own colour, and the whole world."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import yaml

from pioneer_description.core.fleet_view import (
    Bounds,
    RobotView,
    fleet_config,
    known_bounds,
    tool_name,
)
from pioneer_description.core.scene import TOLERANCE, marks_of, view_of

TEMPLATE = yaml.safe_load((Path(__file__).parents[2] / "rviz" / "multi_pioneer.rviz").read_text())
WORLD = Bounds(-6.0, -14.0, 24.0, 22.0)


def shown(*robots):
    return fleet_config(TEMPLATE, robots, WORLD, (1500, 1000))


def pioneers(count):
    return [
        RobotView(f"pioneer{number}", f"/pioneer{number}/base_scan")
        for number in range(1, count + 1)
    ]


@pytest.mark.parametrize("count", [1, 2, 5, 15])
def test_only_the_robots_that_there_are_are_shown_each_in_colours_of_its_own(count):
    marks = marks_of(shown(*pioneers(count)))
    assert {mark.robot for mark in marks} - {""} == {
        f"pioneer{number}" for number in range(1, count + 1)
    }
    scans = [mark.colour for mark in marks if mark.what == "scan"]
    assert len(scans) == count
    for one, other in combinations(scans, 2):
        assert max(abs(a - b) for a, b in zip(one, other, strict=True)) > 2 * TOLERANCE, (
            one,
            other,
        )


def test_a_robot_of_another_kind_is_shown_with_its_own_model_laser_and_name():
    rover = RobotView("rover", "/rover/scan", "rover/robot_description")
    config = shown(pioneers(1)[0], rover)
    marks = [mark for mark in marks_of(config) if mark.robot == "rover"]
    assert [mark.what for mark in marks] == [
        "scan",
        "local costmap",
        "global plan",
        "local plan",
        "name",
    ]
    assert marks[0].topic == "/rover/scan"
    assert marks[1].topic == "/rover/move_base/local_costmap/costmap"
    group = next(
        one for one in config["Visualization Manager"]["Displays"] if one["Name"] == "rover"
    )
    model = group["Displays"][0]
    assert (model["Robot Description"], model["TF Prefix"]) == ("rover/robot_description", "rover")


def test_each_robot_has_a_goal_and_a_pose_tool_under_its_name():
    tools = shown(*pioneers(1), RobotView("rover", "/rover/scan"))["Visualization Manager"]["Tools"]
    named = {tool_name(tool): tool["Topic"] for tool in tools if tool_name(tool)}
    assert named == {
        "pioneer1 goal": "/pioneer1/map_goal_pose",
        "rover goal": "/rover/map_goal_pose",
        "pioneer1 pose": "/pioneer1/initialpose",
        "rover pose": "/rover/initialpose",
    }
    assert [tool["Class"] for tool in tools[:5]] == [
        "rviz/MoveCamera", "rviz/Interact", "rviz/Select", "rviz/FocusCamera", "rviz/Measure",
    ]  # fmt: skip


def test_the_view_holds_the_whole_world():
    view = view_of(shown(*pioneers(1)))
    assert view.centre == (9.0, 4.0)
    assert 0.9 * 1000 < (WORLD.top - WORLD.bottom) * view.scale < 1000


def test_a_world_is_as_large_as_the_known_part_of_its_map():
    cells = np.full((40, 60), -1, np.int8)
    cells[10:30, 5:50] = 0
    assert known_bounds(cells, 0.5, -10.0, -20.0) == Bounds(-7.5, -15.0, 15.0, -5.0)
    assert known_bounds(np.full((4, 4), -1, np.int8), 0.5, 0.0, 0.0) is None
