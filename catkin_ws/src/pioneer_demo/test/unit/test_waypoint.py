"""Waypoints are reachable, have clearance and distance from each other, and repeat with the seed."""

import itertools

import numpy as np
import pytest

from pioneer_demo.error import NoWaypointError
from pioneer_demo.scenario.floor import Floor
from pioneer_demo.scenario.place import check_places
from pioneer_demo.scenario.waypoint import WaypointConfig, fleet_waypoints
from pioneer_fleet.geometry import Pose
from pioneer_node.core.document import DocumentError

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
        assert not any(
            leg.goal.x < 3.0 and leg.goal.y > 16.0 for legs in legs_of(seed) for leg in legs
        )


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


def corridor(width, shift=0.0):
    """Returns two rooms of 4 m, joined by a corridor of 8 m and this width [m], in cells of 0.05 m."""
    free = np.zeros((120, 340), bool)
    free[20:100, 10:90] = free[20:100, 250:330] = True
    low = 60 + round((shift - width / 2) / 0.05)
    free[low : low + round(width / 0.05), 90:250] = True
    return Floor(0.05, 0.0, 0.0, free, ~free)


@pytest.mark.parametrize("shift", [0.0, 0.05, 0.1, 0.15])
@pytest.mark.parametrize("width", [0.5, 0.7, 0.9, 1.2])
def test_a_goal_behind_a_corridor_that_the_planner_takes_is_taken(width, shift):
    floor = corridor(width, shift)
    check_places(floor, [(2.0, 3.0)], [[(15.0, 3.0)]])
    ((leg,),) = fleet_waypoints(
        floor, [Pose(2.0, 3.0)], CONFIG, np.random.default_rng(1), [[[15.0, 3.0]]]
    )
    assert leg.length == pytest.approx(13.0, rel=0.11)


def test_a_goal_behind_a_corridor_too_narrow_is_refused():
    floor = corridor(0.35)
    with pytest.raises(NoWaypointError, match="cannot reach its goal"):
        fleet_waypoints(floor, [Pose(2.0, 3.0)], CONFIG, np.random.default_rng(1), [[[15.0, 3.0]]])
    with pytest.raises(
        DocumentError, match=r"the goal \(15, 3\) cannot be reached from the robot's place before"
    ):
        check_places(floor, [(2.0, 3.0)], [[(2.5, 3.0), (15.0, 3.0)]])


@pytest.mark.parametrize(
    ("start", "goal", "text"),
    [
        ((2.0, 3.0), (0.2, 3.0), r"the goal \(0.2, 3\) is in a wall"),
        ((2.0, 3.0), (99.0, 3.0), r"the goal \(99, 3\) is outside the map"),
        ((2.0, 3.0), (0.6, 3.0), r"the goal \(0.6, 3\) is closer than 0.23 m to a wall"),
        ((-5.0, 3.0), (2.0, 3.0), r"the start \(-5, 3\) is outside the map"),
        ((8.0, 1.0), (2.0, 3.0), r"the start \(8, 1\) is in a wall"),
    ],
)
def test_a_place_where_no_robot_can_be_is_named(start, goal, text):
    with pytest.raises(DocumentError, match=text):
        check_places(corridor(0.9), [start], [[goal]])
