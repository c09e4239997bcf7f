"""The floor's cells, clearances and paths."""

import itertools

import numpy as np
import pytest

from pioneer_demo.scenario.floor import Floor, distances, drivable, route


def floor_from(art, resolution=1.0, x=0.0, y=0.0):
    """Returns a floor drawn with '.' for free, '#' for occupied and ' ' for unknown; the top line has the largest y."""
    cells = np.array([list(line) for line in art][::-1])
    return Floor(resolution, x, y, cells == ".", cells == "#")


MAZE = floor_from(["#######", "#..#..#", "#..#..#", "#.....#", "#######"])


def test_cells_and_positions_agree():
    floor = floor_from(["....", "...."], resolution=0.5, x=-1.0, y=3.0)
    assert floor.position(1, 2) == pytest.approx((0.25, 3.75))
    assert floor.cell(0.25, 3.75) == (1, 2)
    assert not floor.contains(*floor.cell(-1.1, 3.0))


def test_clearance_is_the_distance_to_what_is_not_free():
    clearance = floor_from(
        ["#####", "#...#", "#...#", "#...#", "#####"], resolution=0.1
    ).clearance()
    assert clearance[2, 2] == pytest.approx(0.2)
    assert clearance[0, 0] == 0.0


def test_the_edge_of_the_map_is_no_free_space():
    assert floor_from(["..."]).clearance().max() == 1.0


def test_cropping_keeps_positions():
    floor = floor_from(["     ", "  ## ", "  .. ", "     "], x=10.0)
    small = floor.cropped()
    assert small.free.shape == (2, 2)
    assert small.free[small.cell(12.5, 1.5)]
    assert small.occupied[small.cell(13.5, 2.5)]


def test_the_way_leads_round_the_wall():
    steps = distances(MAZE, *MAZE.cell(1.5, 3.5))
    way = route(steps, *MAZE.cell(5.5, 3.5))
    assert way[0] == MAZE.cell(1.5, 3.5)
    assert way[-1] == MAZE.cell(5.5, 3.5)
    assert MAZE.cell(3.5, 1.5) in way
    assert all(max(abs(a - c), abs(b - d)) == 1 for (a, b), (c, d) in itertools.pairwise(way))


def test_what_cannot_be_reached_is_infinitely_far():
    floor = floor_from(["..#.."])
    steps = distances(floor, 0, 0)
    assert np.isinf(steps[0, 3])
    assert np.isinf(steps[0, 2])


@pytest.mark.parametrize("target", [(40, 0), (40, 40), (40, 20), (13, 37)])
def test_distances_in_open_space_are_close_to_the_straight_ones(target):
    floor = Floor(0.2, 0.0, 0.0, np.ones((41, 41), bool), np.zeros((41, 41), bool))
    assert distances(floor, 0, 0)[target] == pytest.approx(0.2 * np.hypot(*target), rel=0.11)


def test_a_drivable_floor_keeps_its_distance_from_walls():
    floor = Floor(0.05, 0.0, 0.0, np.ones((100, 100), bool), np.zeros((100, 100), bool))
    coarse = drivable(floor, 0.6, 0.2)
    assert coarse.resolution == pytest.approx(0.2)
    rows, cols = np.nonzero(coarse.free)
    nearest = min(coarse.position(rows.min(), cols.min()))
    assert 0.55 <= nearest <= 0.85
