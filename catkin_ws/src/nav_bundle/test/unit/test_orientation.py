"""Headings along a path in global_planner's orientation modes; its grid paths and its potential."""

import math

import numpy as np
import pytest
from drawn_room import grid_from_text

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.config import CostmapConfig, StaticConfig
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.planning.global_planner import (
    GlobalPlanner,
    GlobalPlannerConfig,
    Orientation,
    oriented,
    visible_potential,
)
from nav_bundle.planning.planner import EVERYTHING, path_between

START = Pose(0.0, 0.0, -1.0)
CORNER = np.array(
    [[x, 0.0, 0.0] for x in range(6)]
    + [[5.0, y, 0.0] for y in range(1, 5)]
    + [[5.0, 5.0, math.pi]],
    np.float64,
)
QUARTER = math.pi / 2


@pytest.mark.parametrize(
    ("mode", "first", "later"),
    [
        (Orientation.NONE, 0.0, 0.0),
        (Orientation.FORWARD, 0.0, QUARTER),
        (Orientation.BACKWARD, math.pi, -QUARTER),
        (Orientation.LEFTWARD, -QUARTER, 0.0),
        (Orientation.RIGHTWARD, QUARTER, math.pi),
    ],
)
def test_a_path_is_driven_forward_backward_or_sideways(
    mode: Orientation, first: float, later: float
) -> None:
    headings = oriented(CORNER, START, mode, 1)[:, 2]
    assert math.isclose(math.cos(headings[1] - first), 1.0)
    assert math.isclose(math.cos(headings[-2] - later), 1.0)
    assert headings[-1] == math.pi


def test_headings_turn_evenly_from_the_robots_to_the_goals() -> None:
    headings = oriented(CORNER, START, Orientation.INTERPOLATE, 1)[:, 2]
    assert math.isclose(headings[0], START.yaw)
    assert math.isclose(math.cos(headings[-1] - math.pi), 1.0)
    assert np.ptp(np.diff(headings)) < 1e-9


def test_headings_follow_the_path_and_turn_on_its_last_straight_part() -> None:
    headings = oriented(CORNER, START, Orientation.FORWARD_THEN_INTERPOLATE, 1)[:, 2]
    np.testing.assert_allclose(headings[1:5], 0.0, atol=1e-9)
    np.testing.assert_allclose(headings[6:], np.linspace(QUARTER, math.pi, 5), atol=1e-9)


def test_a_wider_window_rounds_the_corner() -> None:
    headings = oriented(CORNER, START, Orientation.FORWARD, 3)[:, 2]
    assert 0.0 < headings[3] < headings[5] < QUARTER


def test_a_path_of_one_pose_keeps_its_heading() -> None:
    one = np.array([[1.0, 2.0, 3.0]])
    for mode in Orientation:
        np.testing.assert_array_equal(oriented(one, START, mode, 1)[:, :2], one[:, :2])


@pytest.fixture
def costmap() -> Costmap:
    costmap = Costmap(CostmapConfig(robot_radius=0.1, layers=(StaticConfig(),)))
    costmap.set_map(
        grid_from_text(["############", *["#..........#"] * 8, "#####..#####", "############"], 0.1)
    )
    costmap.update(Pose(0.15, 0.65), ())
    return costmap


def test_a_grid_path_steps_from_cell_to_cell(costmap: Costmap) -> None:
    planner = GlobalPlanner(GlobalPlannerConfig(use_grid_path=True, orientation_mode=1))
    path = path_between(planner, costmap, Pose(0.15, 0.35), Pose(1.05, 0.85, 2.0))
    steps = np.abs(np.diff(path[:, :2], axis=0)).max(axis=1)
    np.testing.assert_allclose(steps, 0.1, atol=1e-9)
    assert path[-1].tolist() == [1.05, 0.85, 2.0]
    assert 0.0 <= path[0, 2] <= QUARTER


def test_the_potential_is_shown_from_nought_to_its_scale(costmap: Costmap) -> None:
    search = GlobalPlanner(GlobalPlannerConfig()).search(
        costmap, Pose(0.15, 0.35), Pose(1.05, 0.85)
    )
    search.advance(EVERYTHING)
    shown = visible_potential(search.potential, 100)
    place = costmap.geometry
    assert shown[place.row_of(0.35), place.col_of(0.15)] == 0
    assert shown.max() == 100
    assert shown[0, 0] == -1
