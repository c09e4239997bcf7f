"""Whether a fleet can keep the right of way in its world, from the files that describe both."""

from pathlib import Path

import pytest
import yaml

from pioneer_demo.scenario.right_of_way import fleet_refusal
from pioneer_demo.scenario.world_folder import map_names, place_count
from pioneer_node.core.fleet_file import RobotEntry

SOURCES = Path(__file__).parents[3]
MAPS = SOURCES / "pioneer_gazebo_ros" / "pioneer_gazebo" / "map"
POSES = SOURCES / "pioneer_gazebo_ros" / "pioneer_description" / "config"
SHIPPED = SOURCES / "pioneer_2dnav" / "config" / "costmap_common_params.yaml"
ROVER = SHIPPED.with_name("rover_params.yaml")


def no_footprint(description):
    raise ValueError(f"the footprint of {description} is unknown: no such file")


def refusal(*robots, world="closed_maze", footprint_of=no_footprint):
    return fleet_refusal(robots, MAPS / f"{world}.yaml", POSES, SHIPPED, footprint_of)


@pytest.mark.parametrize("world", map_names(MAPS))
def test_in_every_shipped_world_a_full_fleet_can(world):
    count = place_count(POSES, world)
    robots = [RobotEntry(f"pioneer{number}") for number in range(1, count + 1)]
    assert refusal(*robots, world=world) == ""


def test_a_fleet_of_different_shipped_robots_can():
    assert refusal(RobotEntry("pioneer1"), RobotEntry("rover1", navigation=str(ROVER))) == ""


@pytest.mark.parametrize(
    ("half", "reason"), [(0.15, ""), (0.4, "the footprint of rover1 reaches 0.57 m")]
)
def test_a_described_robot_has_the_footprint_of_its_description(half, reason):
    square = [[half, half], [half, -half], [-half, -half], [-half, half]]
    rover = RobotEntry("rover1", description="rover.xacro")
    found = refusal(RobotEntry("pioneer1"), rover, footprint_of=lambda _: square)
    assert found.startswith(reason)
    assert bool(found) == bool(reason)


def test_a_description_without_a_footprint_is_a_reason_unless_parameters_have_one():
    rover = RobotEntry("rover1", description="rover.xacro")
    assert refusal(RobotEntry("pioneer1"), rover).startswith("the footprint of rover.xacro is unkn")
    rover = RobotEntry("rover1", description="rover.xacro", navigation=str(ROVER))
    assert refusal(RobotEntry("pioneer1"), rover) == ""


def test_robots_of_another_navigation_do_not_count():
    assert "fewer than two" in refusal(RobotEntry("a"), RobotEntry("b", navigation="none"))


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        (
            {"local_costmap": {"robot_radius": 0.5, "footprint": []}},
            "the footprint of wide reaches 0.50 m",
        ),
        (
            {"TrajectoryPlannerROS": {"xy_goal_tolerance": 0.5}},
            "the xy_goal_tolerance of wide is 0.5 m",
        ),
        ({"local_costmap": {"robot_radius": "wide"}}, ""),
        ([], ""),
    ],
)
def test_robots_too_wide_or_too_inexact_for_places_cannot(tmp_path, parameters, reason):
    file = tmp_path / "wide.yaml"
    file.write_text(yaml.safe_dump(parameters))
    found = refusal(RobotEntry("pioneer1"), RobotEntry("wide", navigation=str(file)))
    assert found.startswith(reason)
    assert bool(found) == bool(reason)


def test_a_map_that_cannot_be_read_is_no_reason(tmp_path):
    robots = [RobotEntry("a"), RobotEntry("b")]
    assert fleet_refusal(robots, tmp_path / "no.yaml", POSES, SHIPPED, no_footprint) == ""
