"""Whether robots can keep the right of way on a map."""

import numpy as np
import pytest

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.footprint import Footprint
from nav_bundle.maps.grid import Grid
from pioneer_traffic.simulation import FOOTPRINT
from pioneer_traffic.suitability import refusal

CELL = 0.05
PIONEER = Footprint(FOOTPRINT)


def rooms(door: float) -> Grid:
    """Returns two rooms of 4 m x 4 m and 2 m x 4 m, joined by a door of this width [m] in a wall of 0.2 m."""
    cells = np.full((90, 134), 100, np.int8)
    cells[5:85, 5:85] = 0
    cells[5:85, 89:129] = 0
    half = round(0.5 * door / CELL)
    cells[45 - half : 45 + half, 85:89] = 0
    return Grid(CELL, Pose(0.0, 0.0, 0.0), cells)


LARGE, SMALL = (2.0, 2.0), (5.5, 2.0)


def test_rooms_joined_by_a_door_are_suitable() -> None:
    assert refusal(rooms(1.0), {"a": LARGE, "b": SMALL}, {"a": PIONEER, "b": PIONEER}) == ""


def test_a_start_behind_a_shut_door_is_named() -> None:
    found = refusal(rooms(0.0), {"a": LARGE, "b": SMALL}, {"a": PIONEER, "b": PIONEER})
    assert found == "no way at least 0.56 m wide leads to the start of b"


@pytest.mark.parametrize(("door", "is_fault"), [(0.0, False), (0.5, True), (1.0, False)])
def test_a_room_behind_a_door_that_only_navigation_uses_is_a_reason(
    door: float, is_fault: bool
) -> None:
    """The right of way refused goals there that robots reached without it."""
    found = refusal(rooms(door), {"a": LARGE}, {"a": PIONEER})
    assert ("behind passages narrower than 0.56 m" in found) == is_fault


def test_a_start_outside_the_map_is_named() -> None:
    assert "start of a" in refusal(rooms(1.0), {"a": (-5.0, 0.0)}, {"a": PIONEER})


def test_a_corridor_in_which_no_robot_can_turn_is_a_reason() -> None:
    cells = np.full((40, 200), 100, np.int8)
    cells[14:27, 5:195] = 0
    grid = Grid(CELL, Pose(0.0, 0.0, 0.0), cells)
    assert refusal(grid, {"a": (1.0, 1.0)}, {"a": PIONEER}) == "nowhere in the map can a robot turn"


def test_a_large_robot_is_named_with_its_radius() -> None:
    large = Footprint(1.5 * FOOTPRINT)
    found = refusal(rooms(1.0), {"a": LARGE, "b": SMALL}, {"a": PIONEER, "b": large})
    assert found.startswith("the footprint of b reaches 0.54 m from its centre")
