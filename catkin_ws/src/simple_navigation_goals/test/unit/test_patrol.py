"""A patrol is read from its file as written; an invalid one gets a one-line error."""

import math
from pathlib import Path

import pytest

from simple_navigation_goals.patrol import PatrolError
from simple_navigation_goals.waypoint import Waypoint
from simple_navigation_goals.waypoint_file import read_patrol

GOOD = """
loop: 3
waypoints:
  - {x: 1, y: 2.5, heading: 90, wait: 4}
  - {x: -1.0, y: 0.0}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "round.yaml"
    path.write_text(text)
    return path


def test_a_patrol_has_metres_degrees_and_seconds(tmp_path: Path) -> None:
    patrol = read_patrol(written(tmp_path, GOOD), "map")
    assert patrol.rounds == 3
    assert patrol.waypoints == (
        Waypoint(1.0, 2.5, math.pi / 2, "map", 4.0),
        Waypoint(-1.0, 0.0, 0.0, "map"),
    )


@pytest.mark.parametrize(("loop", "rounds"), [("true", 0), ("false", 1), ("7", 7)])
def test_loop_is_for_ever_once_or_a_number(tmp_path: Path, loop: str, rounds: int) -> None:
    assert (
        read_patrol(
            written(tmp_path, f"{{loop: {loop}, waypoints: [{{x: 0, y: 0}}]}}"), "map"
        ).rounds
        == rounds
    )


def test_the_file_may_name_another_frame(tmp_path: Path) -> None:
    patrol = read_patrol(written(tmp_path, "{frame: /odom, waypoints: [{x: 0, y: 0}]}"), "map")
    assert patrol.waypoints[0].frame == "odom"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "a patrol needs frame, loop, waypoints"),
        ("- {x: 1, y: 2}", "a patrol needs"),
        ("waypoints: []", "a list of"),
        ("{waypoints: [{x: 1, y: 2}], lop: true}", "unknown field 'lop'"),
        ("waypoints: [{x: 1, y: 2}, {x: 1}]", "waypoint 2 has no y"),
        ("waypoints: [{x: 1, y: north}]", "waypoint 1: y must be a number, not 'north'"),
        (
            "waypoints: [{x: 1, y: 2, yaw: 1}]",
            "waypoint 1: unknown field 'yaw'; known: x, y, heading, wait",
        ),
        ("waypoints: [{x: 1, y: .nan}]", "waypoint 1: y is nan"),
        ("waypoints: [{x: 1, y: 2, wait: -1}]", "must not be negative"),
        ("{loop: 0, waypoints: [{x: 1, y: 2}]}", "loop must be"),
        ("waypoints: [{x: 1", "is not valid YAML"),
    ],
)
def test_what_is_wrong_is_one_line_with_the_files_name(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(PatrolError, match=words) as caught:
        read_patrol(written(tmp_path, text), "map")
    assert "round.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(PatrolError, match=r"cannot read the patrol .*nowhere.yaml: No such file"):
        read_patrol(tmp_path / "nowhere.yaml", "map")


def test_the_shipped_example_is_a_patrol() -> None:
    example = Path(__file__).parents[2] / "config" / "patrol_small_world.yaml"
    assert len(read_patrol(example, "map").waypoints) == 3
