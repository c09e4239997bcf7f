"""Courses and parameters of the bench's trials: random values follow the request and repeat with the seed."""

import itertools
import math

import numpy as np
import pytest

from pioneer_bench.core import course
from pioneer_bench.core.ride import with_changes
from pioneer_bench.core.traffic import narrow_space, random_tours, seconds_alone
from pioneer_bench.hard import random_changes
from pioneer_traffic.roadmap import roadmap_from_space


def test_changes_reach_into_the_tree_and_leave_the_rest() -> None:
    shipped = {"rate": 5.0, "map": {"width": 4.0, "height": 4.0}}
    changed = with_changes(shipped, {"map/width": 6.0, "new/name": 1})
    assert changed == {"rate": 5.0, "map": {"width": 6.0, "height": 4.0}, "new": {"name": 1}}
    assert shipped["map"] == {"width": 4.0, "height": 4.0}


def test_random_parameters_repeat_with_their_seed_alone_and_both_costmaps_have_the_same() -> None:
    assert random_changes(1) == random_changes(1) != random_changes(2)
    for seed in range(20):
        changes = random_changes(seed)
        assert (
            changes["global_costmap/inflation_radius"] == changes["local_costmap/inflation_radius"]
        )
        assert (
            changes["TrajectoryPlannerROS/min_vel_theta"]
            == -changes["TrajectoryPlannerROS/max_vel_theta"]
        )


@pytest.mark.parametrize("seed", range(5))
def test_starts_and_goals_among_cylinders_have_room_for_a_robot(seed: int) -> None:
    made = course.clutter(seed)
    np.testing.assert_array_equal(made.hidden.circles, course.clutter(seed).hidden.circles)
    for pose, (x, y, radius) in itertools.product((made.start, *made.goals), made.hidden.circles):
        assert math.hypot(pose.x - x, pose.y - y) > radius + 0.3


def test_the_map_shows_walls_and_not_what_is_hidden() -> None:
    made = course.clutter(1, count=3)
    grid = made.grid()
    x, y, _ = made.hidden.circles[0]
    column, row = (
        int((x - grid.origin.x) / grid.resolution),
        int((y - grid.origin.y) / grid.resolution),
    )
    assert grid.cells[row, column] == 0
    assert np.count_nonzero(grid.cells == 100) > 0


def test_random_tours_keep_robots_apart_and_repeat_with_their_seed() -> None:
    space = narrow_space("cells")
    roadmap = roadmap_from_space(space)
    starts, tours = random_tours(space, roadmap, robots=4, waypoints=2, seed=7)
    assert (starts, tours) == random_tours(space, roadmap, robots=4, waypoints=2, seed=7)
    assert [len(tour) for tour in tours] == [2] * 4
    assert min(math.dist(one, other) for one, other in itertools.combinations(starts, 2)) >= 1.2


def test_a_robot_alone_in_a_corridor_needs_about_its_length_by_its_speed() -> None:
    space = narrow_space("swap")
    roadmap = roadmap_from_space(space)
    near, far = (seconds_alone(space, roadmap, (0.45, 0.45), [(x, 0.45)]) for x in (10.0, 20.0))
    assert 1.8 < far / near < 2.2
