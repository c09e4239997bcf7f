"""The compiled kernels agree with results computed by hand or by brute force."""

import math

import numpy as np
import pytest
from drawn_room import grid_from_text
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.localisation import likelihood_kernel as likelihood
from nav_bundle.localisation.sensor_model import placement
from nav_bundle.maps.grid import OCCUPIED


def brute_force(cells: NDArray[np.int8], cap: int) -> NDArray[np.int64]:
    rows, cols = np.indices(cells.shape)
    result = np.full(cells.shape, cap * cap)
    for row, col in np.argwhere(cells == OCCUPIED):
        result = np.minimum(result, (rows - row) ** 2 + (cols - col) ** 2)
    return result


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 30),
    st.integers(1, 30),
    st.integers(1, 12),
    st.floats(0, 0.3),
)
def test_the_distance_field_is_exact(
    seed: int, rows: int, cols: int, cap: int, share: float
) -> None:
    cells = np.where(np.random.default_rng(seed).random((rows, cols)) < share, OCCUPIED, 0).astype(
        np.int8
    )
    field = np.empty(cells.shape, np.uint16)
    likelihood.distance_field(cells, OCCUPIED, cap, field)
    assert (field == brute_force(cells, cap)).all()


def test_a_read_only_map_has_a_field() -> None:
    cells = np.frombuffer(bytes([0, 100, 0, 0]), np.int8).reshape(2, 2)
    field = np.empty((2, 2), np.uint16)
    likelihood.distance_field(np.ascontiguousarray(cells), OCCUPIED, 9, field)
    assert field.tolist() == [[1, 0], [2, 1]]


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_a_ray_measures_to_the_first_wall(yaw: float) -> None:
    # If the map and the robot are rotated together, the ranges stay the same.
    grid = grid_from_text(
        ["########", "#......#", "#......#", "########"], 0.5, Pose(1.0, 2.0, yaw)
    )
    robot = grid.origin.compose(Pose(1.25, 1.0, 0.0))
    poses = np.array([[robot.x, robot.y, robot.yaw]])
    bearings = np.array([0.0, math.pi / 2, math.pi, -math.pi / 2])
    ranges = np.empty((1, 4))
    laser = np.array([0.1, 0.0, 0.0])
    likelihood.expected_ranges(poses, laser, bearings, grid.cells, placement(grid), 10.0, ranges)
    assert np.allclose(ranges, [[2.15, 0.5, 0.85, 0.5]])


def test_a_ray_that_leaves_the_map_sees_nothing() -> None:
    grid = grid_from_text(["..."])
    ranges = np.empty((1, 1))
    arguments = (
        np.array([[0.5, 0.5, 0.0]]),
        np.zeros(3),
        np.zeros(1),
        grid.cells,
        placement(grid),
        7.0,
        ranges,
    )
    likelihood.expected_ranges(*arguments)
    assert ranges.tolist() == [[7.0]]


@pytest.mark.parametrize("yaw", [0.0, 1.1])
def test_likelihoods_are_looked_up_at_the_end_points(yaw: float) -> None:
    grid = grid_from_text(["...", ".#.", "..."], 0.5, Pose(-3.0, 1.0, yaw))
    field = likelihood.Field(np.empty((3, 3), np.uint16), placement(grid))
    likelihood.distance_field(grid.cells, OCCUPIED, 9, field.squares)
    robot = grid.origin.compose(Pose(0.75, 0.25, math.pi / 2))
    points = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [50.0, 0.0]])
    table = np.arange(82.0)
    out = np.array([1000.0])
    poses = np.array([[robot.x, robot.y, robot.yaw]])
    likelihood.add_likelihoods(poses, points, field, table, out)
    assert out[0] == 1000.0 + 1 + 0 + 2 + 81
    counts = np.zeros(4, np.int64)
    likelihood.count_agreement(poses, points, field, 2, counts)
    assert counts.tolist() == [1, 1, 0, 0]
