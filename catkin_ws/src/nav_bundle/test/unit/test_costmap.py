"""Costs around obstacles, marking and clearing by lasers, and which cells are recomputed."""

import math

import numpy as np
import pytest
from drawn_room import grid_from_text

from nav_bundle.base.pose import Pose
from nav_bundle.base.scan import points_from_ranges
from nav_bundle.costmap.config import InflationConfig, costmap_config_from_parameters
from nav_bundle.costmap.cost import (
    FREE,
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    cost_by_occupancy,
    occupancy_by_cost,
)
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.footprint import FootprintError, footprint_from_parameters
from nav_bundle.costmap.layer import Observation, ObservationBuffer
from pioneer_node.core.parameter import ParameterError

FOOTPRINT = [[0.2, 0.2], [0.2, -0.2], [-0.3, -0.2], [-0.3, 0.2]]
LASER = {"topic": "base_scan", "marking": True, "clearing": True}
SENSING = {
    "observation_sources": "laser",
    "laser": LASER,
    "obstacle_range": 2.0,
    "raytrace_range": 3.0,
}


def costmap_of(rows, resolution=0.1, **parameters):
    given = {
        "static_map": True,
        "footprint": FOOTPRINT,
        "inflation_radius": 0.5,
        "cost_scaling_factor": 5.0,
    }
    costmap = Costmap(costmap_config_from_parameters({**given, **parameters}, "test"))
    costmap.set_map(grid_from_text(rows, resolution))
    return costmap


def rolling(**parameters):
    given = {
        "rolling_window": True,
        "width": 3.0,
        "height": 3.0,
        "footprint": FOOTPRINT,
        "inflation_radius": 0.0,
    }
    return Costmap(costmap_config_from_parameters({**SENSING, **given, **parameters}, "test"))


def seen_by(costmap, x, y, *points):
    layer = costmap.config.layers[-2]
    return [Observation(layer.sources[0], x, y, np.array(points, np.float64).reshape(-1, 2))]


def cost_at(costmap, x, y):
    return costmap.cells[costmap.geometry.row_of(y), costmap.geometry.col_of(x)]


def cost_of_distance(distance, costmap):
    config = next(layer for layer in costmap.config.layers if isinstance(layer, InflationConfig))
    inscribed = costmap.footprint.inscribed_radius
    if distance == 0.0:
        return LETHAL
    if distance <= inscribed:
        return INSCRIBED
    if (
        distance
        > math.ceil(config.inflation_radius / costmap.geometry.resolution)
        * costmap.geometry.resolution
        + 1e-9
    ):
        return FREE
    return int(252 * math.exp(-config.cost_scaling_factor * (distance - inscribed)))


def test_every_cell_costs_what_its_distance_to_the_nearest_obstacle_says():
    generator = np.random.default_rng(1)
    rows = [
        "".join("#" if generator.random() < 0.01 else "." for _ in range(60)) for _ in range(50)
    ]
    costmap = costmap_of(rows)
    costmap.update(Pose(1.0, 1.0), [])
    obstacles = np.argwhere(costmap.cells == LETHAL)
    for row in range(50):
        for col in range(60):
            nearest = math.sqrt(((obstacles - (row, col)) ** 2).sum(axis=1).min())
            assert costmap.cells[row, col] == cost_of_distance(nearest * 0.1, costmap), (row, col)


def test_a_partial_update_leaves_what_a_whole_one_would():
    generator = np.random.default_rng(2)
    rows = [
        "".join("#" if generator.random() < 0.005 else "." for _ in range(120)) for _ in range(100)
    ]
    costmap, fresh = (costmap_of(rows, **SENSING) for _ in range(2))
    costmap.update(Pose(5.0, 5.0), [])
    for step in range(10):
        x = 4.0 + 0.3 * step
        angles = generator.uniform(-math.pi, math.pi, 40)
        reach = generator.uniform(0.6, 4.0, 40)
        points = np.stack([x + reach * np.cos(angles), 5.0 + reach * np.sin(angles)], axis=1)
        seen = seen_by(costmap, x, 5.0, *points)
        changed = costmap.update(Pose(x, 5.0), seen)
        assert (
            0
            < (changed.row_1 - changed.row_0) * (changed.col_1 - changed.col_0)
            < costmap.cells.size
        )
        fresh.clear_outside(Pose(), 1e6)
        fresh.update(Pose(x, 5.0), seen_by(fresh, x, 5.0, *points))
        np.testing.assert_array_equal(costmap.cells, fresh.cells)


def test_nothing_is_recomputed_when_the_laser_sees_the_same():
    costmap = costmap_of(["." * 60] * 60, **SENSING)
    for _ in range(2):
        changed = costmap.update(Pose(3.0, 3.0), seen_by(costmap, 3.0, 3.0, (4.0, 3.0)))
    assert not changed


def test_a_return_marks_and_the_way_to_it_clears():
    costmap = rolling()
    costmap.update(Pose(), seen_by(costmap, 0.0, 0.0, (0.8, 0.0)))
    assert cost_at(costmap, 0.8, 0.0) == LETHAL
    costmap.update(Pose(), seen_by(costmap, 0.0, 0.0, (1.2, 0.0)))
    assert cost_at(costmap, 0.8, 0.0) == FREE
    assert cost_at(costmap, 1.2, 0.0) == LETHAL


def test_returns_beyond_the_obstacle_range_clear_without_marking():
    costmap = rolling(width=8.0, height=8.0)
    costmap.update(Pose(), seen_by(costmap, 0.0, 0.0, (1.5, 0.0)))
    costmap.update(Pose(), seen_by(costmap, 0.0, 0.0, (2.5, 0.0)))
    assert cost_at(costmap, 1.5, 0.0) == FREE
    assert LETHAL not in costmap.cells


@pytest.mark.parametrize("seed", range(5))
def test_a_wall_that_is_still_seen_beyond_the_obstacle_range_is_not_forgotten(seed):
    """The scans cross the wall at drawn bearings, up to the raytrace range and a little beyond it."""
    generator = np.random.default_rng(seed)
    costmap = rolling(width=12.0, height=12.0)
    sides = np.arange(-2.0, 2.0, 0.02)
    costmap.update(
        Pose(), seen_by(costmap, 0.0, 0.0, *((1.5, y) for y in np.arange(-0.5, 0.5, 0.02)))
    )
    marked = costmap.cells == LETHAL
    assert marked.any()
    for _ in range(20):
        x, y = generator.uniform((-1.6, -1.0), (-0.6, 1.0))
        costmap.update(Pose(), seen_by(costmap, x, y, *((1.5, side) for side in sides)))
    assert (costmap.cells == LETHAL)[marked].all()


@pytest.mark.parametrize("seed", range(5))
def test_what_has_gone_is_forgotten_once_beams_pass_through_its_cells(seed):
    generator = np.random.default_rng(seed)
    costmap = rolling(width=12.0, height=12.0)
    bearings = np.linspace(-np.pi, np.pi, 720)
    walls = np.stack([np.cos(bearings), np.sin(bearings)], axis=1) * 5.0
    for _ in range(20):
        person = generator.uniform(-1.4, 1.4, 2)
        costmap.update(Pose(), seen_by(costmap, 0.0, 0.0, person, *walls))
        costmap.update(Pose(), seen_by(costmap, 0.0, 0.0, *walls))
        assert LETHAL not in costmap.cells


def test_what_persists_keeps_marking_until_its_time_is_over():
    costmap = rolling(laser={**LASER, "observation_persistence": 1.0})
    buffer = ObservationBuffer(1.0)
    for stamp, x, expected in ((0.0, 0.8, LETHAL), (0.6, 1.2, LETHAL), (1.3, 1.2, FREE)):
        buffer.add(stamp, seen_by(costmap, 0.0, 0.0, (x, 0.0))[0])
        costmap.update(Pose(), buffer.current(stamp))
        assert cost_at(costmap, 0.8, 0.0) == expected


def test_without_persistence_only_the_newest_observation_counts_however_old():
    costmap, buffer = rolling(), ObservationBuffer(0.0)
    first, second = seen_by(costmap, 0.0, 0.0, (0.8, 0.0)) + seen_by(costmap, 0.0, 0.0, (0.9, 0.0))
    buffer.add(1.0, first)
    buffer.add(2.0, second)
    assert buffer.current(9.0) == [second]
    assert buffer.newest == 2.0


def test_each_source_marks_and_clears_as_configured():
    costmap = rolling(
        observation_sources="laser camera",
        laser={**LASER, "marking": False},
        camera={"topic": "points", "data_type": "PointCloud2", "obstacle_range": 1.0},
    )
    laser, camera = costmap.config.layers[-2].sources
    far, near, beyond = (np.array([[x, 0.0]]) for x in (1.3, 0.8, 1.2))
    costmap.update(Pose(), [Observation(laser, 0.0, 0.0, far), Observation(camera, 0.0, 0.0, near)])
    assert cost_at(costmap, 0.8, 0.0) == LETHAL
    assert (costmap.cells == LETHAL).sum() == 1
    costmap.update(Pose(), [Observation(camera, 0.0, 0.0, beyond)])
    assert cost_at(costmap, 0.8, 0.0) == LETHAL
    costmap.update(Pose(), [Observation(laser, 0.0, 0.0, far)])
    assert LETHAL not in costmap.cells


def test_rays_clear_no_farther_than_the_raytrace_range():
    costmap = rolling(width=8.0, height=8.0, obstacle_range=3.9)
    costmap.update(Pose(), seen_by(costmap, 0.0, 0.0, (3.5, 0.0)))
    costmap.update(Pose(), seen_by(costmap, 0.0, 0.0, (3.95, 0.0)))
    assert cost_at(costmap, 3.5, 0.0) == LETHAL


def test_what_lies_under_the_robot_is_cleared():
    costmap = rolling()
    costmap.update(Pose(), seen_by(costmap, 0.0, 0.0, (0.1, 0.1), (-0.25, -0.1)))
    assert LETHAL not in costmap.cells


def test_a_rolling_window_keeps_what_stays_inside():
    costmap = rolling()
    costmap.update(Pose(), seen_by(costmap, 0.0, 0.0, (1.02, 0.52)))
    costmap.update(Pose(0.73, 0.21), [])
    assert cost_at(costmap, 1.02, 0.52) == LETHAL
    assert (costmap.cells == LETHAL).sum() == 1
    costmap.update(Pose(5.0, 5.0), [])
    assert LETHAL not in costmap.cells


def test_clearing_keeps_the_square_around_the_robot():
    costmap = rolling()
    costmap.update(Pose(), seen_by(costmap, 0.0, 0.0, (0.5, 0.0), (1.3, 0.0)))
    costmap.clear_outside(Pose(), 2.0)
    costmap.update(Pose(), [])
    assert cost_at(costmap, 0.5, 0.0) == LETHAL
    assert cost_at(costmap, 1.3, 0.0) == FREE


@pytest.mark.parametrize(("track", "expected"), [(True, UNKNOWN), (False, FREE)])
def test_the_map_s_unknown_cells_stay_unknown_only_where_that_is_tracked(track, expected):
    costmap = costmap_of(
        ["?" + "." * 19] * 9, track_unknown_space=track, inflation_radius=0.0, **SENSING
    )
    costmap.update(Pose(1.5, 0.45), [])
    assert costmap.cells[4, 0] == expected


def test_costs_are_published_on_costmap_2d_s_scale():
    table = occupancy_by_cost()
    assert [table[cost] for cost in (0, 1, 252, 253, 254, 255)] == [0, 1, 98, 99, 100, -1]
    assert (np.diff(table[:255].astype(int)) >= 0).all()


def test_layered_parameters_mean_the_same_as_classic_ones():
    layered = {
        "footprint": FOOTPRINT,
        "plugins": [
            {"name": "static", "type": "costmap_2d::StaticLayer"},
            {"name": "seen", "type": "costmap_2d::ObstacleLayer"},
            {"name": "around", "type": "costmap_2d::InflationLayer"},
        ],
        "seen": SENSING,
        "around": {"inflation_radius": 1.5, "cost_scaling_factor": 5.0},
    }
    classic = {
        **SENSING,
        "static_map": True,
        "footprint": FOOTPRINT,
        "inflation_radius": 1.5,
        "cost_scaling_factor": 5.0,
    }
    assert costmap_config_from_parameters(layered, "l") == costmap_config_from_parameters(
        classic, "c"
    )


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"map_type": "octree"}, "octree"),
        ({"plugins": [{"name": "x", "type": "costmap_2d::OctreeLayer"}]}, "no such layer"),
        ({**SENSING, "laser": {**LASER, "data_type": "Image"}}, "there are.*PointCloud2"),
        (
            {**SENSING, "laser": {**LASER, "observation_persistence": -1.0}},
            "observation_persistence",
        ),
        ({"resolution": 0.0}, "positive"),
    ],
)
def test_wrong_parameters_are_refused_by_name(parameters, words):
    with pytest.raises(ParameterError, match=words):
        costmap_config_from_parameters(parameters, "move_base/local_costmap")


def test_padding_grows_the_footprint_and_its_radii():
    footprint = footprint_from_parameters(str(FOOTPRINT), 0.46, 0.01)
    assert footprint.inscribed_radius == pytest.approx(0.21)
    assert footprint.circumscribed_radius == pytest.approx(math.hypot(0.31, 0.21))
    with pytest.raises(FootprintError, match="three"):
        footprint_from_parameters([[0, 0], [1, 1]], 0.46, 0.0)


def test_ranges_without_a_return_give_points_only_where_infinity_is_valid():
    ranges = np.array([1.0, np.inf, np.nan, 0.05, 8.0], np.float32)
    assert len(points_from_ranges(ranges, 0.0, 0.1, 0.1, 8.0, False)) == 1
    assert len(points_from_ranges(ranges, 0.0, 0.1, 0.1, 8.0, True)) == 2


def test_a_goal_in_an_obstacle_of_the_map_or_outside_it_is_ruled_out_at_once() -> None:
    costmap = costmap_of(["#" * 20, *["#" + "." * 18 + "#"] * 18, "#" * 20])
    assert costmap.goal_fault(Pose(1.0, 1.0)) == ""
    assert "in an obstacle of the map" in costmap.goal_fault(Pose(0.05, 1.0))
    assert "less than 0.21 m from one" in costmap.goal_fault(Pose(0.25, 1.0))
    outside = costmap.goal_fault(Pose(7.0, 1.0))
    assert (
        outside
        == "The goal (7.00, 1.00) is outside the map, which spans x from 0 to 2 and y from 0 to 2 m."
    )


def test_what_only_sensors_have_seen_rules_no_goal_out() -> None:
    costmap = costmap_of(["." * 40] * 40, **SENSING)
    costmap.update(Pose(2.0, 2.0), seen_by(costmap, 2.0, 2.0, (3.0, 2.0)))
    assert cost_at(costmap, 3.0, 2.0) == LETHAL
    assert costmap.goal_fault(Pose(3.0, 2.0)) == ""
    assert rolling().goal_fault(Pose(9.0, 9.0)) == ""


@pytest.mark.parametrize(("threshold", "same_as"), [(254, 100), (1000, 100), (-5, 0)])
def test_a_lethal_threshold_outside_the_range_of_a_map_is_clamped(
    threshold: int, same_as: int
) -> None:
    for trinary in (False, True):
        table = cost_by_occupancy(threshold, trinary, True, 255)
        assert table.tolist() == cost_by_occupancy(same_as, trinary, True, 255).tolist()
        assert table[100] == LETHAL
