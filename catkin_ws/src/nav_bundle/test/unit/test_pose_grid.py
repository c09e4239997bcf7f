"""Poses compose as transforms do; grids convert between points and cells without loss."""

import math

import numpy as np
import pytest
from drawn_room import grid_from_text
from hypothesis import given
from hypothesis import strategies as st

from nav_bundle.base.error import MapError
from nav_bundle.base.pose import Pose, angle_difference, normalized_angle
from nav_bundle.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid

metres = st.floats(-100, 100)
poses = st.builds(Pose, metres, metres, st.floats(-10, 10))


def assert_same(first: Pose, second: Pose) -> None:
    assert math.isclose(first.x, second.x, abs_tol=1e-9)
    assert math.isclose(first.y, second.y, abs_tol=1e-9)
    assert abs(angle_difference(first.yaw, second.yaw)) < 1e-9


@given(poses)
def test_a_pose_composed_with_its_inverse_is_the_identity(pose: Pose) -> None:
    assert_same(pose.compose(pose.inverse()), Pose())
    assert_same(pose.inverse().compose(pose), Pose())


@given(poses, poses, poses)
def test_composition_is_associative(a: Pose, b: Pose, c: Pose) -> None:
    assert_same(a.compose(b).compose(c), a.compose(b.compose(c)))


@given(st.floats(-100, 100), st.floats(-100, 100))
def test_an_angle_difference_is_the_shortest_turn(first: float, second: float) -> None:
    turn = angle_difference(first, second)
    assert abs(turn) <= math.pi
    assert abs(normalized_angle(second + turn - first)) < 1e-9


def test_composition_turns_before_it_moves() -> None:
    assert_same(Pose(1, 2, math.pi / 2).compose(Pose(1, 0, 0.1)), Pose(1, 3, math.pi / 2 + 0.1))


@given(poses, st.floats(0.01, 1), st.integers(-5000, 5000), st.integers(-5000, 5000))
def test_a_cell_holds_its_own_centre(origin: Pose, resolution: float, row: int, col: int) -> None:
    grid = Grid(resolution, origin, np.zeros((3, 4), np.int8))
    assert grid.cell_at(*grid.point_at(row, col)) == (row, col)
    cells = np.array([[row, col]])
    assert (grid.cells_at(grid.points_at(cells)) == cells).all()


def test_a_drawing_has_its_top_row_at_the_largest_y() -> None:
    grid = grid_from_text(["#.?", "..."], resolution=0.5, origin=Pose(-1, -2))
    assert (grid.rows, grid.cols) == (2, 3)
    assert grid.cells[1].tolist() == [OCCUPIED, FREE, UNKNOWN]
    assert grid.cell_at(-0.9, -1.4) == (1, 0)


@pytest.mark.parametrize("resolution", [0.0, -1.0, math.nan, math.inf])
def test_a_map_without_a_positive_resolution_is_refused(resolution: float) -> None:
    with pytest.raises(MapError, match="resolution"):
        Grid(resolution, Pose(), np.zeros((1, 1), np.int8))


def test_a_map_without_cells_is_refused() -> None:
    with pytest.raises(MapError, match="int8 cells"):
        Grid(1.0, Pose(), np.zeros((0, 3), np.int8))
    with pytest.raises(MapError, match="int8 cells"):
        Grid(1.0, Pose(), np.zeros((3, 3), np.uint8))  # type: ignore[arg-type]


@pytest.mark.parametrize("rows", [["..", "."], ["x"]])
def test_a_drawing_that_is_no_map_is_refused(rows: list[str]) -> None:
    with pytest.raises(MapError, match="drawn map"):
        grid_from_text(rows)
