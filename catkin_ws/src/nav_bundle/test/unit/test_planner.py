"""The contract of every global planner, on small drawn maps."""

import contextlib
import itertools
import math

import numpy as np
import pytest
from drawn_room import grid_from_text

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.config import costmap_config_from_parameters
from nav_bundle.costmap.cost import INSCRIBED, UNKNOWN
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.layer import Observation
from nav_bundle.planning.global_planner import (
    GlobalPlanner,
    GlobalPlannerConfig,
    global_planner_config_from_parameters,
)
from nav_bundle.planning.navfn import NavfnConfig, NavfnPlanner, weights
from nav_bundle.planning.navfn_kernel import coarsen
from nav_bundle.planning.planner import (
    GoalOutsideError,
    NoPathError,
    StartOutsideError,
    nearest_inside,
    path_between,
    with_goal,
)
from pioneer_node.core.parameter import ParameterError

RESOLUTION = 0.1
ROOMS = [
    "####################",
    "#........#.........#",
    "#........#.........#",
    "#........#.........#",
    "#..................#",
    "#........#.........#",
    "#........#.........#",
    "#........#.........#",
    "####################",
]
CLOSED = [row[:9] + "#" + row[10:] for row in ROOMS]
WIDE = ["####################", *["#..................#"] * 10, "####################"]


def costmap_of(rows, inflation=0.0, **parameters):
    given = {
        "static_map": True,
        "robot_radius": 0.05,
        "footprint_padding": 0.0,
        "inflation_radius": inflation,
    }
    costmap = Costmap(
        costmap_config_from_parameters({**given, "cost_scaling_factor": 3.0, **parameters}, "test")
    )
    costmap.set_map(grid_from_text(rows, RESOLUTION))
    costmap.update(Pose(0.15, 0.15), [])
    return costmap


def length(path):
    return float(np.hypot(*np.diff(path[:, :2], axis=0).T).sum())


def costs_along(costmap, path):
    place = costmap.geometry
    return [costmap.cells[place.row_of(y), place.col_of(x)] for x, y, _ in path]


# With GlobalPlanner's default cost_factor of 3, all costs above 67 count the same, and these maps have few lower ones.
PLANNERS = [
    NavfnPlanner(NavfnConfig()),
    GlobalPlanner(GlobalPlannerConfig(cost_factor=0.8)),
    GlobalPlanner(GlobalPlannerConfig(cost_factor=0.8, use_dijkstra=False)),
]


FROM_CELL_TO_CELL = GlobalPlanner(GlobalPlannerConfig(cost_factor=0.8, use_grid_path=True))


@pytest.fixture(params=[*PLANNERS, FROM_CELL_TO_CELL], ids=["navfn", "dijkstra", "a*", "grid path"])
def planner(request):
    return request.param


def test_a_path_leads_from_the_robot_to_the_goal(planner):
    path = path_between(planner, costmap_of(ROOMS), Pose(0.25, 0.25), Pose(1.75, 0.25, 1.0))
    assert path[0, :2] == pytest.approx((0.25, 0.25), abs=RESOLUTION)
    assert tuple(path[-1]) == pytest.approx((1.75, 0.25, 1.0))


def test_a_path_has_no_gaps(planner):
    path = path_between(planner, costmap_of(ROOMS), Pose(0.25, 0.25), Pose(1.75, 0.75))
    assert np.hypot(*np.diff(path[:, :2], axis=0).T).max() <= 1.5 * RESOLUTION


def test_a_path_crosses_nothing_that_touches(planner):
    costmap = costmap_of(ROOMS, 0.3)
    path = path_between(planner, costmap, Pose(0.25, 0.25), Pose(1.75, 0.25))
    assert max(costs_along(costmap, path)) < INSCRIBED


def test_over_free_ground_a_path_is_nearly_straight(planner):
    path = path_between(planner, costmap_of(WIDE), Pose(0.25, 0.25), Pose(1.75, 0.85))
    longest = 1.083 if planner is FROM_CELL_TO_CELL else 1.05  # eight directions add up to 8.24 %
    assert length(path) < longest * math.hypot(1.5, 0.6)


def test_costs_push_a_path_off_the_wall(planner):
    near, far = (
        path_between(planner, costmap_of(WIDE, inflation), Pose(0.35, 0.35), Pose(1.65, 0.35))
        for inflation in (0.0, 0.8)
    )
    assert far[:, 1].max() > near[:, 1].max() + RESOLUTION


def test_a_closed_room_has_no_path(planner):
    with pytest.raises(NoPathError, match="Failed to get a plan"):
        path_between(planner, costmap_of(CLOSED), Pose(0.25, 0.25), Pose(1.75, 0.25))


def test_a_goal_in_a_wall_is_approached_as_far_as_the_tolerance_allows(planner):
    costmap = costmap_of(ROOMS)
    goal = Pose(0.95, 0.25)
    with pytest.raises(NoPathError):
        path_between(planner, costmap, Pose(0.25, 0.25), goal, 0.05)
    path = path_between(planner, costmap, Pose(0.25, 0.25), goal, 0.3)
    assert 0.0 < math.hypot(path[-1, 0] - goal.x, path[-1, 1] - goal.y) <= 0.3


def test_start_and_goal_must_lie_on_the_map(planner):
    with pytest.raises(StartOutsideError, match="off the global costmap"):
        path_between(planner, costmap_of(ROOMS), Pose(-1.0, 0.0), Pose(1.0, 0.25))
    with pytest.raises(GoalOutsideError, match="off the global costmap"):
        path_between(planner, costmap_of(ROOMS), Pose(0.25, 0.25), Pose(5.0, 0.25))


def test_the_way_to_where_the_robot_stands_is_short(planner):
    path = path_between(planner, costmap_of(ROOMS), Pose(0.25, 0.25), Pose(0.25, 0.25, 2.0))
    assert tuple(path[-1]) == pytest.approx((0.25, 0.25, 2.0))
    assert length(path) < 2 * RESOLUTION


def test_a_robot_too_near_to_a_wall_gets_away(planner):
    costmap = costmap_of(WIDE, 0.5, robot_radius=0.25)
    start = Pose(0.25, 0.55)
    assert costs_along(costmap, [(start.x, start.y, 0.0)]) == [INSCRIBED]
    path = path_between(planner, costmap, start, Pose(1.45, 0.55))
    assert path[-1, 0] == pytest.approx(1.45)


def test_a_search_in_small_slices_finds_the_same_path(planner):
    costmap = costmap_of(ROOMS, 0.3)
    whole = path_between(planner, costmap, Pose(0.25, 0.25), Pose(1.75, 0.25))
    search = planner.search(costmap, Pose(0.25, 0.25), Pose(1.75, 0.25))
    slices = list(
        itertools.takewhile(
            lambda path: path is None, (search.advance(10) for _ in itertools.count())
        )
    )
    assert len(slices) > 3
    path = search.advance(10)
    np.testing.assert_array_equal(path, whole)


def test_a_search_does_not_see_later_changes(planner):
    costmap = costmap_of(ROOMS)
    search = planner.search(costmap, Pose(0.25, 0.25), Pose(1.75, 0.25))
    costmap.cells[:, 9] = 254
    assert search.advance(1 << 40) is not None


def test_every_open_pair_of_places_is_joined(planner):
    generator = np.random.default_rng(3)
    rows = [
        "#" * 40,
        *["#" + "".join(generator.choice([".", "#"], 38, p=[0.75, 0.25])) + "#" for _ in range(38)],
    ]
    costmap = costmap_of([*rows, "#" * 40])
    free = np.argwhere(costmap.cells == 0)
    for _ in range(40):
        (r0, c0), (r1, c1) = free[generator.integers(len(free), size=2)]
        start, goal = (
            Pose((c0 + 0.5) * 0.1, (r0 + 0.5) * 0.1),
            Pose((c1 + 0.5) * 0.1, (r1 + 0.5) * 0.1),
        )
        if _joined(costmap.cells, (r0, c0), (r1, c1)):
            assert (
                max(costs_along(costmap, path_between(planner, costmap, start, goal))) < INSCRIBED
            )
        else:
            with pytest.raises(NoPathError):
                path_between(planner, costmap, start, goal)


def _joined(cells, start, goal):
    seen, stack = {tuple(start)}, [tuple(start)]
    while stack:
        row, col = stack.pop()
        for cell in ((row, col + 1), (row, col - 1), (row + 1, col), (row - 1, col)):
            if cells[cell] < INSCRIBED and cell not in seen:
                seen.add(cell)
                stack.append(cell)
    return tuple(goal) in seen


@pytest.mark.parametrize("allowed", [True, False])
def test_unknown_ground_is_crossed_only_where_allowed(allowed):
    rows = [row.replace(".", "?", 1) if i == 4 else row for i, row in enumerate(ROOMS)]
    rows[4] = ROOMS[4][:9] + "?" + ROOMS[4][10:]
    costmap = costmap_of(rows, track_unknown_space=True)
    assert UNKNOWN in costmap.cells
    planner = NavfnPlanner(NavfnConfig(allow_unknown=allowed))
    if allowed:
        assert len(path_between(planner, costmap, Pose(0.25, 0.25), Pose(1.75, 0.25))) > 2
    else:
        with pytest.raises(NoPathError):
            path_between(planner, costmap, Pose(0.25, 0.25), Pose(1.75, 0.25))


def test_what_the_map_does_not_know_is_passed_on_the_right():
    parameters = {
        "observation_sources": "laser",
        "laser": {"topic": "base_scan"},
        "obstacle_range": 3.0,
    }
    planner = NavfnPlanner(NavfnConfig())
    for start, goal in (
        (Pose(0.5, 2.05), Pose(3.5, 2.05)),
        (Pose(3.5, 2.05, math.pi), Pose(0.5, 2.05)),
    ):
        costmap = costmap_of(["." * 40] * 41, 0.5, **parameters)
        source = costmap.config.layers[1].sources[0]
        front = np.column_stack([np.full(9, 2.0), np.linspace(1.85, 2.25, 9)])
        costmap.update(start, [Observation(source, start.x, start.y, front)])
        path = path_between(planner, costmap, start, goal)
        beside = path[np.abs(path[:, 0] - 2.0).argmin()]
        side = math.copysign(1.0, goal.x - start.x) * (beside[1] - 2.05)
        assert side < -0.2


def test_what_is_narrower_than_a_robot_need_not_be_given_way() -> None:
    parameters = {
        "observation_sources": "laser",
        "laser": {"topic": "base_scan"},
        "obstacle_range": 3.0,
    }
    costmap = costmap_of(["." * 40] * 41, 0.5, **parameters)
    source = costmap.config.layers[1].sources[0]
    for width, robot in ((0.2, False), (0.5, True)):
        points = np.column_stack(
            [np.full(11, 2.0), 2.025 + np.linspace(-width / 2.0, width / 2.0, 11)]
        )
        costmap.reset()
        costmap.update(Pose(0.5, 2.05), [Observation(source, 0.5, 2.05, points)])
        assert (len(costmap.unmapped(Pose(0.5, 2.05), 3.0)) > 0) == robot


def reached(planner, costmap, start, goal):
    search = planner.search(costmap, start, goal)
    assert search.advance(1 << 40) is not None
    cell = costmap.geometry.row_of(goal.y), costmap.geometry.col_of(goal.x)
    return int((search.potential < 1.0e9).sum()), float(search.potential[cell])


def test_a_star_looks_at_less_and_finds_as_cheap_a_way():
    costmap = costmap_of(["." * 120] * 120)
    start, goal = Pose(2.05, 6.05), Pose(11.65, 6.05)
    (all_cells, cost), (some_cells, same) = (
        reached(planner, costmap, start, goal) for planner in PLANNERS[1:]
    )
    assert some_cells < 0.5 * all_cells
    assert same == pytest.approx(cost, rel=0.01)


def cheapest(planner, costmap, start, goal):
    """Returns the path cost from the planner's potential; very large if there is no path."""
    search = planner.search(costmap, start, goal)
    with contextlib.suppress(NoPathError):
        search.advance(1 << 40)
    return float(search.potential[costmap.geometry.row_of(goal.y), costmap.geometry.col_of(goal.x)])


def test_a_star_s_ways_are_at_most_two_hundredths_dearer_than_dijkstra_s():
    generator = np.random.default_rng(7)
    rows = ["".join(generator.choice([".", "#"], 60, p=[0.97, 0.03])) for _ in range(60)]
    costmap = costmap_of(rows, 0.3)
    free = np.argwhere(costmap.cells == 0)
    for _ in range(40):
        (r0, c0), (r1, c1) = free[generator.integers(len(free), size=2)]
        start, goal = (
            Pose((c0 + 0.5) * 0.1, (r0 + 0.5) * 0.1),
            Pose((c1 + 0.5) * 0.1, (r1 + 0.5) * 0.1),
        )
        dijkstra, a_star = (cheapest(planner, costmap, start, goal) for planner in PLANNERS[1:])
        assert a_star <= 1.02 * dijkstra


def test_a_block_weighs_halfway_between_its_least_and_mean_passable_cell():
    """This includes the smaller blocks at the edges. A block without a passable cell stays closed."""
    costs = np.random.default_rng(3).choice(
        np.array([0, 40, 252, 253, 254, 255], np.uint8), (11, 14)
    )
    costs[4:8, 4:8] = 254
    table, closed = weights(True), 255
    coarse = np.full((5, 6), closed, np.uint8)
    coarsen(costs, table, coarse)
    expected = np.full_like(coarse, closed)
    for row, col in np.ndindex(3, 4):
        added = table[costs[4 * row : 4 * row + 4, 4 * col : 4 * col + 4]]
        if (added >= 0.0).any():
            passable = added[added >= 0.0]
            expected[row + 1, col + 1] = int((passable.min() + passable.mean()) / 2.0)
    assert expected[2, 2] == closed
    assert np.array_equal(coarse, expected)


def test_a_star_finds_the_way_round_that_its_guide_does_not_know():
    """To the guide, walls thinner than its blocks have gaps, so it expects a way straight through."""
    rows = [".." * 30] * 30 + ["." + "#" * 59] + [".." * 30] * 29
    costmap = costmap_of(rows)
    start, goal = Pose(5.55, 1.05), Pose(5.55, 4.85)
    dijkstra, a_star = (cheapest(planner, costmap, start, goal) for planner in PLANNERS[1:])
    assert dijkstra > 100 * 50.0
    assert a_star == pytest.approx(dijkstra, rel=0.01)


@pytest.mark.parametrize(
    "wrong",
    [{"use_quadratic": False}, {"orientation_mode": 7}, {"cost_factor": 9.0}, {"lethal_cost": 255}],
)
def test_global_planner_s_parameters_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ParameterError):
        global_planner_config_from_parameters(wrong, "GlobalPlanner")


def test_a_goal_beside_the_map_is_taken_to_its_border_within_the_tolerance():
    place = costmap_of(WIDE).geometry
    inside = nearest_inside(place, Pose(2.3, 0.5, 1.0), 0.4)
    assert (inside.x, inside.y, inside.yaw) == (pytest.approx(1.95), 0.5, 1.0)
    assert nearest_inside(place, Pose(2.3, 0.5), 0.3) == Pose(2.3, 0.5)
    assert nearest_inside(place, Pose(0.5, 0.5), 0.0) == Pose(0.5, 0.5)


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_plan_that_ends_beside_the_goal_can_be_led_to_it(planner):
    goal = Pose(1.95, 0.55, 0.5)  # in the wall
    costmap = costmap_of(WIDE, 0.2)
    path = path_between(planner, costmap, Pose(0.5, 0.5), goal, 0.5)
    assert path[-1, 0] < 1.9
    assert with_goal(path, goal, RESOLUTION / 2.0)[-1].tolist() == [1.95, 0.55, 0.5]
    end = Pose(*path[-1])
    assert with_goal(path, end, RESOLUTION) is path


def test_cells_opened_around_a_robot_are_as_before_after_the_next_update():
    costmap = costmap_of(ROOMS)
    before = costmap.cells.copy()
    costmap.open_around(Pose(0.15, 0.15), 0.4)
    assert costmap.cells[0, 0] == 0
    costmap.update(Pose(0.15, 0.15), [])
    assert np.array_equal(costmap.cells, before)
