"""The rule by which others know a robot's reach before anything is planned agrees with the planner."""

import numpy as np
import pytest
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.check_parameters import shipped_parameters
from nav_bundle.costmap.config import costmap_config_from_parameters
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.maps.grid import Grid
from nav_bundle.planning.navfn import NavfnConfig, NavfnPlanner
from nav_bundle.planning.planner import NoPathError
from pioneer_node.core.reach import PIONEER_RADIUS, areas, clearance

RESOLUTION = 0.05
SIZE = 60
"""Cells of a map's edge."""


def drawn_cells(rng: np.random.Generator) -> NDArray[np.int8]:
    """Returns a map with walls, doors of all widths, rubbish and unknown ground; -1, 0 or 100 [row, col]."""
    cells = np.zeros((SIZE, SIZE), np.int8)
    for _ in range(4):
        place = rng.integers(5, SIZE - 5)
        door = rng.integers(0, SIZE - 16)
        width = rng.integers(0, 14)
        wall = cells[place : place + 2] if rng.random() < 0.5 else cells[:, place : place + 2].T
        wall[:] = 100
        wall[:, door : door + width] = 0
    rows, cols = rng.integers(0, SIZE, (2, 6))
    cells[rows, cols] = 100
    row, col = rng.integers(0, SIZE - 12, 2)
    unknown = cells[row : row + 12, col : col + 12]
    unknown[unknown == 0] = -1
    return cells


def pioneers_costmap(cells: NDArray[np.int8]) -> Costmap:
    """Returns the global costmap that a Pioneer has of a map."""
    shipped = "move_base/global_costmap/"
    names = (
        "footprint",
        "footprint_padding",
        "inflation_radius",
        "cost_scaling_factor",
        "static_map",
    )
    parameters = shipped_parameters()
    own = {name: parameters[shipped + name] for name in names}
    costmap = Costmap(costmap_config_from_parameters(own, "test"))
    costmap.set_map(Grid(RESOLUTION, Pose(), cells))
    costmap.update(Pose(1.5, 1.5), [])
    return costmap


def plans(costmap: Costmap, start: Pose, goal: Pose) -> bool:
    """Returns whether navfn finds a path to exactly this goal."""
    search = NavfnPlanner(NavfnConfig(default_tolerance=0.0)).search(costmap, start, goal)
    try:
        while search.advance(10**6) is None:
            pass
    except NoPathError:
        return False
    return True


def test_the_radius_is_the_padded_footprints() -> None:
    costmap = pioneers_costmap(np.zeros((SIZE, SIZE), np.int8))
    assert costmap.footprint.inscribed_radius == pytest.approx(PIONEER_RADIUS)


@pytest.mark.parametrize("seed", range(30))
def test_a_place_can_be_reached_by_the_rule_exactly_if_the_planner_finds_a_way(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = drawn_cells(rng)
    numbers = areas(cells == 100, RESOLUTION)
    costmap = pioneers_costmap(cells)
    # Nearer to a wall, navfn lets the robot cross the cells around it, from which it may have to get away.
    starts = np.argwhere((numbers > 0) & (clearance(cells == 100, RESOLUTION) > 2 * PIONEER_RADIUS))
    assert len(starts)
    for start in rng.choice(starts, 3):
        for goal in rng.integers(0, SIZE, (15, 2)):
            if (
                not numbers[tuple(goal)]
                and np.hypot(*(goal - start)) < 2 * PIONEER_RADIUS / RESOLUTION
            ):
                continue
            expected = bool(numbers[tuple(goal)] == numbers[tuple(start)])
            at = [
                Pose((col + 0.5) * RESOLUTION, (row + 0.5) * RESOLUTION)
                for row, col in (start, goal)
            ]
            assert plans(costmap, *at) == expected, (start, goal)
