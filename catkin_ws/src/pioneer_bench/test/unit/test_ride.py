"""A robot drives courses with the shipped parameters, without ROS: what it must reach, and with which clearance."""

from collections.abc import Callable

import numpy as np
import pytest

from nav_bundle.base.pose import Pose
from pioneer_bench.core import blocked, course
from pioneer_bench.core.course import Course
from pioneer_bench.core.ride import Body, Ride, ride, with_changes
from pioneer_bench.hard import random_changes, shipped_parameters


@pytest.fixture(scope="module")
def parameters() -> dict[str, object]:
    return shipped_parameters()


def driven(on: Course, parameters: dict[str, object], **changes: object) -> Ride:
    planner = {f"TrajectoryPlannerROS/{name}": value for name, value in changes.items()}
    return ride(on, with_changes(parameters, planner))


def test_a_corner_is_not_cut(parameters: dict[str, object]) -> None:
    kept = driven(course.slalom(), parameters)
    assert (kept.reached, kept.contacts) == (2, 0)
    assert kept.clearance > 0.2
    assert driven(course.slalom(), parameters, clearance_scale=0.0).clearance < 0.08


def test_a_robot_that_pushes_what_the_laser_does_not_see_gives_up(
    parameters: dict[str, object],
) -> None:
    against = driven(course.doorstep(), parameters)
    assert (against.reached, against.stuck) == (0, False)
    assert "commanded to drive and does not move" in against.last
    assert against.given_up[0] < 60.0


@pytest.mark.parametrize(("seed", "maze"), [(5, 5), (37, 37), (29, 5)])
def test_a_robot_does_not_circle_for_good_where_turning_is_cheapest(
    parameters: dict[str, object], seed: int, maze: int
) -> None:
    """Parameter set 29 looks 0.35 m ahead: in maze 5 the robot used to turn full circles at each corner for 600 s."""
    through = ride(course.maze(maze), with_changes(parameters, random_changes(seed)), maze)
    assert (through.reached, through.contacts, through.stuck) == (4, 0, False)


def test_dwa_keeps_its_corners_from_walls_and_does_not_turn_before_them_for_good(
    parameters: dict[str, object],
) -> None:
    parameters = {**parameters, "base_local_planner": "dwa_local_planner/DWAPlannerROS"}
    assert driven(course.slalom(), parameters).clearance > 0.25
    through = ride(course.maze(5), parameters, 5)
    assert (through.reached, through.contacts, through.stuck) == (4, 0, False)


def test_a_narrow_door_is_still_passed(parameters: dict[str, object]) -> None:
    through = driven(course.doors(0.7), parameters)
    assert (through.reached, through.contacts, through.recoveries) == (8, 0, 0)


def test_a_cylinder_that_the_map_does_not_show_is_not_touched(
    parameters: dict[str, object],
) -> None:
    among = driven(course.clutter(2), parameters)
    assert (among.reached, among.contacts) == (8, 0)
    assert among.way / among.seconds > 0.45


@pytest.mark.parametrize("make", [blocked.detour, blocked.trap, blocked.shut_door, blocked.thicket])
@pytest.mark.parametrize(("seed", "jitter"), [(1, 0.0), (4, 1.5)])
def test_a_way_round_what_the_map_does_not_show_is_found(
    parameters: dict[str, object], make: Callable[[int], Course], seed: int, jitter: float
) -> None:
    round_it = ride(make(seed), parameters, seed, jitter)
    assert (round_it.reached, round_it.contacts, round_it.given_up) == (2, 0, ())


@pytest.mark.parametrize("make", [blocked.barrier, blocked.occupied])
@pytest.mark.parametrize(("seed", "jitter"), [(1, 0.0), (4, 1.5)])
def test_a_goal_that_cannot_be_reached_is_given_up_and_the_next_one_is_reached(
    parameters: dict[str, object], make: Callable[[int], Course], seed: int, jitter: float
) -> None:
    """A robot used to drive to and fro before such a goal for ever."""
    before_it = ride(make(seed), parameters, seed, jitter)
    assert (before_it.reached, before_it.contacts, before_it.wrongly_given_up) == (1, 0, 0)
    assert before_it.given_up[0] < 120.0


def test_the_gap_is_that_between_body_and_wall() -> None:
    body = Body(Course((course.box(1.0, -1.0, 2.0, 1.0),), Pose(), ()))
    assert body.gap == pytest.approx(0.8)
    turned = Body(Course((course.box(1.0, -1.0, 2.0, 1.0),), Pose(0.0, 0.0, np.pi / 4), ()))
    assert turned.gap == pytest.approx(1.0 - 0.2 * np.sqrt(2.0))
    round_thing = Course((), Pose(), (), course.EMPTY)
    assert Body(round_thing).gap == np.inf


@pytest.mark.parametrize("seed", range(5))
def test_a_maze_is_one_piece(seed: int) -> None:
    grid = course.maze(seed).grid()
    free = grid.cells == 0
    reached = np.zeros_like(free)
    start = course.maze(seed).start
    row, col = (
        int((value - corner) / 0.05)
        for value, corner in ((start.y, grid.origin.y), (start.x, grid.origin.x))
    )
    reached[row, col] = True
    while True:
        grown = reached.copy()
        grown[1:] |= reached[:-1]
        grown[:-1] |= reached[1:]
        grown[:, 1:] |= reached[:, :-1]
        grown[:, :-1] |= reached[:, 1:]
        grown &= free
        if (grown == reached).all():
            break
        reached = grown
    for goal in course.maze(seed).goals:
        assert reached[int((goal.y - grid.origin.y) / 0.05), int((goal.x - grid.origin.x) / 0.05)]
