"""A waypoint that no robot can reach on the map is refused, with the reason."""

import math

import numpy as np
import pytest

from pioneer_fleet.geometry import Pose
from pioneer_web.state.reach import Reach

RESOLUTION = 0.05


@pytest.fixture
def cells():
    """A map of 10 m x 5 m: a wall around it, and one in the middle."""
    found = np.zeros((100, 200), np.int8)
    found[[0, -1], :] = found[:, [0, -1]] = 100
    found[:, 100:102] = 100
    return found


@pytest.fixture
def reach(cells):
    return Reach(cells, RESOLUTION, Pose(-5.0, -2.5))


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        (Pose(-1.0, 1.0), ""),
        (Pose(0.0, 0.0), "a wall"),
        (Pose(-0.15, 0.0), "a wall"),
        (Pose(-0.35, 0.0), ""),
        (Pose(2.0, 0.0), "no way"),
        (Pose(5.5, 0.0), "outside"),
        (Pose(-5.5, 0.0), "outside"),
        (Pose(1e9, -1e9), "outside"),
    ],
)
def test_the_reason_is_the_wall_the_map_or_the_way(reach, goal, words):
    refusal = reach.refusal(Pose(-3.0, 0.0), goal)
    assert words in refusal
    assert bool(refusal) == bool(words)


def test_a_door_makes_a_way(cells):
    cells[40:60, 100:102] = 0
    reach = Reach(cells, RESOLUTION, Pose(-5.0, -2.5))
    assert reach.refusal(Pose(-3.0, 0.0), Pose(2.0, 0.0)) == ""


def test_unknown_cells_and_an_unknown_start_refuse_nothing(cells):
    cells[1:-1, 101:150] = -1
    cells[:, 100] = -1
    reach = Reach(cells, RESOLUTION, Pose(-5.0, -2.5))
    assert reach.refusal(Pose(-3.0, 0.0), Pose(4.0, 0.0)) == ""
    assert reach.refusal(None, Pose(4.0, 0.0)) == ""


def test_a_turned_map_is_turned_back(cells):
    reach = Reach(cells, RESOLUTION, Pose(2.5, -5.0, math.pi / 2))
    assert reach.refusal(Pose(0.0, -3.0), Pose(1.0, -1.0)) == ""
    assert "a wall" in reach.refusal(Pose(0.0, -3.0), Pose(0.0, 0.0))
    assert "no way" in reach.refusal(Pose(0.0, -3.0), Pose(0.0, 2.0))
