"""The command line is checked before anything starts, in one clear line."""

from pathlib import Path

import pytest

from pioneer_demo.core.error import OptionError
from pioneer_demo.core.option import DemoConfig, config_from_arguments

PLACES = {"closed_maze": 15, "small_world": 6}


def parsed(*arguments):
    return config_from_arguments(arguments, PLACES)


def test_without_arguments_two_robots_drive_in_the_closed_maze():
    assert parsed() == DemoConfig(robots=2, world="closed_maze", waypoints=3, report=Path("demo-report"))


def test_every_option_arrives():
    line = "--robots 5 --world small_world --seed 7 --rtf 0 --waypoints 4 --report out --limit 99"
    config = parsed(*line.split(" "))
    assert config == DemoConfig(5, "small_world", 7, 0.0, 4, Path("out"), 99.0)


def test_a_world_file_goes_by_the_name_of_its_map():
    assert parsed("--world", "/home/me/small_world.world").map_name == "small_world"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--robots", "0"], "--robots must be 1 to 15 in closed_maze, not 0"),
        (["--robots", "16"], "--robots must be 1 to 15 in closed_maze, not 16"),
        (["--robots", "7", "--world", "small_world"], "--robots must be 1 to 6 in small_world, not 7"),
        (["--robots", "two"], "--robots: invalid int value: 'two'"),
        (["--world", "mars"], "--world must be one of closed_maze, small_world, or a .world file"),
        (["--world", "/tmp/mars.world"], "whose map is in pioneer_gazebo/map, not '/tmp/mars.world'"),
        (["--rtf", "-1"], "--rtf must be 0"),
        (["--rtf", "nan"], "--rtf must be 0"),
        (["--waypoints", "0"], "--waypoints must be 1 to 50, not 0"),
        (["--seed", "-4"], "--seed must be 0 to"),
        (["--limit", "-4"], "--limit must be 0"),
        (["--fly"], "unrecognized arguments: --fly"),
    ],
)
def test_a_bad_argument_is_one_line_that_names_it(arguments, words):
    with pytest.raises(OptionError) as raised:
        parsed(*arguments)
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)
