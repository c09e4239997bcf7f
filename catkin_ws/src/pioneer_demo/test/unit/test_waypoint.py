"""Waypoints are reachable, have clearance and distance from each other, and repeat with the seed."""

import itertools

import numpy as np
import pytest

from pioneer_demo.core.error import NoWaypointError
from pioneer_demo.core.floor import Floor
from pioneer_demo.core.waypoint import WaypointConfig, fleet_waypoints
from pioneer_fleet.core.geometry import Pose

CONFIG = WaypointConfig()
STARTS = [Pose(1.5, 1.5), Pose(18.5, 1.5)]


def hall(size=20.0, resolution=0.1):
    """Returns a square hall: a wall down the middle leaves a 3 m gap at the top, and one corner has a closed cell."""
    cells = round(size / resolution)
    wall = np.zeros((cells, cells), bool)
    wall[[0, -1], :] = wall[:, [0, -1]] = True
    wall[: cells - 30, cells // 2] = True
    wall[-40:, 30] = wall[-40, :30] = True
    return Floor(resolution, 0.0, 0.0, ~wall, wall)


def legs_of(seed, starts=STARTS, config=CONFIG, floor=None):
    return fleet_waypoints(floor or hall(), starts, config, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(10))
def test_every_waypoint_keeps_its_clearance_separation_and_length(seed):
    floor = hall()
    clearance, fleet = floor.clearance(), legs_of(seed)
    for legs in fleet:
        assert len(legs) == CONFIG.count
        for leg in legs:
            assert clearance[floor.cell(leg.goal.x, leg.goal.y)] >= CONFIG.clearance - 0.1
            assert CONFIG.shortest <= leg.length <= CONFIG.longest
    for first, second in itertools.product(*fleet):
        assert first.goal.distance(second.goal) >= CONFIG.separation
    assert all(leg.goal.distance(STARTS[1]) >= CONFIG.separation for leg in fleet[0])


def test_no_waypoint_lies_behind_closed_walls():
    for seed in range(5):
        assert not any(leg.goal.x < 3.0 and leg.goal.y > 16.0 for legs in legs_of(seed) for leg in legs)


def test_the_same_seed_gives_the_same_waypoints_and_another_others():
    def goals(seed):
        return [leg.goal for legs in legs_of(seed) for leg in legs]

    assert goals(3) == goals(3)
    assert goals(3) != goals(4)


def test_headings_are_whole_degrees():
    degrees = [np.degrees(leg.goal.yaw) for legs in legs_of(1) for leg in legs]
    assert degrees == pytest.approx(np.round(degrees))


def test_robots_keep_to_different_sides_where_there_is_room():
    sides = [{leg.goal.x < 10.0 for leg in legs} for legs in legs_of(2)]
    assert sides == [{True}, {False}]


def test_a_world_too_small_for_the_wanted_length_gets_shorter_ways():
    cells = np.zeros((50, 50), bool)
    cells[[0, -1], :] = cells[:, [0, -1]] = True
    small = Floor(0.1, 0.0, 0.0, ~cells, cells)
    assert len(legs_of(1, [Pose(2.5, 2.5)], floor=small)[0]) == CONFIG.count


def test_a_start_outside_the_map_is_named():
    with pytest.raises(NoWaypointError, match=r"robot 1 stands at \(-1\.00, -1\.00\)"):
        legs_of(1, [Pose(-1.0, -1.0)])


def test_no_room_is_an_error_that_says_what_to_try():
    crowded = WaypointConfig(separation=50.0)
    with pytest.raises(NoWaypointError, match="fewer robots"):
        legs_of(1, config=crowded)
