"""Other robots in a costmap, rolling and rotated maps, and parameters that change at run time."""

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from drawn_room import grid_from_text

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.config import (
    CostmapConfig,
    FleetConfig,
    InflationConfig,
    ObstacleConfig,
    SourceConfig,
    StaticConfig,
    costmap_config_from_parameters,
)
from nav_bundle.costmap.cost import FREE, INSCRIBED, LETHAL, UNKNOWN
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.layer import Observation
from nav_bundle.maps.grid import Grid

FOOTPRINT = ((0.2, 0.2), (0.2, -0.2), (-0.3, -0.2), (-0.3, 0.2))
LASER = SourceConfig("base_scan", clearing=True)
FLEET = FleetConfig(robots="pioneer1 pioneer2")
WINDOW = CostmapConfig(
    rolling_window=True, width=6.0, height=6.0, resolution=0.1, footprint=FOOTPRINT
)


def cost_at(costmap: Costmap, x: float, y: float) -> int:
    return int(costmap.cells[costmap.geometry.row_of(y), costmap.geometry.col_of(x)])


@pytest.fixture
def fleet() -> Costmap:
    inflation = InflationConfig(inflation_radius=1.0)
    return Costmap(replace(WINDOW, layers=(ObstacleConfig(sources=(LASER,)), FLEET, inflation)))


def test_another_robot_is_lethal_where_it_stands_and_inflated_around(fleet: Costmap) -> None:
    fleet.update(Pose(), (), [Pose(1.5, 0.0, math.pi / 2)])
    assert cost_at(fleet, 1.5, 0.0) == LETHAL
    assert cost_at(fleet, 1.5, -0.25) == LETHAL  # rotated: its rear points south
    assert cost_at(fleet, 1.85, 0.0) == INSCRIBED
    assert FREE < cost_at(fleet, 2.2, 0.0) < INSCRIBED


def test_a_robot_that_drives_on_leaves_nothing_behind(fleet: Costmap) -> None:
    fresh = Costmap(fleet.config)
    fleet.update(Pose(), (), [Pose(1.5, 0.0)])
    changed = fleet.update(Pose(), (), [Pose(1.6, 0.5, 0.3)])
    fresh.update(Pose(), (), [Pose(1.6, 0.5, 0.3)])
    np.testing.assert_array_equal(fleet.cells, fresh.cells)
    assert changed.row_1 - changed.row_0 < fleet.geometry.rows
    assert not fleet.update(Pose(), (), [Pose(1.6, 0.5, 0.3)])


def test_a_robot_that_is_no_longer_heard_of_vanishes(fleet: Costmap) -> None:
    fleet.update(Pose(), (), [Pose(1.5, 0.0)])
    fleet.update(Pose(), (), [])
    assert not fleet.cells.any()


def test_what_the_own_robot_covers_stays_free(fleet: Costmap) -> None:
    fleet.update(Pose(), (), [Pose(0.4, 0.0)])
    assert cost_at(fleet, 0.0, 0.0) != LETHAL
    assert cost_at(fleet, 0.45, 0.0) == LETHAL


def test_a_robot_outside_the_window_is_none(fleet: Costmap) -> None:
    fleet.update(Pose(), (), [Pose(40.0, 0.0)])
    assert not fleet.cells.any()


def test_there_are_no_other_robots_unless_asked_for() -> None:
    config = costmap_config_from_parameters({"static_map": True}, "global_costmap")
    assert not any(isinstance(layer, FleetConfig) for layer in config.layers)
    asked = costmap_config_from_parameters(
        {"fleet_layer": {"robots": ["pioneer1", "/pioneer2"]}}, "global_costmap"
    )
    assert asked.layer_names == ("obstacle_layer", "fleet_layer", "inflation_layer")
    assert asked.layers[1].frames() == ("pioneer1/base_link", "pioneer2/base_link")


MAP = grid_from_text(["....", "..#.", "?..."], 1.0, Pose(10.0, 20.0))


def test_a_map_lies_under_a_rolling_window_where_tf_says() -> None:
    costmap = Costmap(replace(WINDOW, track_unknown_space=True, layers=(StaticConfig(),)))
    assert not costmap.ready
    costmap.set_map(MAP)
    here_from_map = Pose(3.0, 1.0, math.pi / 2).compose(Pose(12.5, 21.5).inverse())
    costmap.update(Pose(3.0, 1.0), (), (), here_from_map)
    assert (costmap.geometry.rows, costmap.geometry.cols) == (60, 60)
    assert cost_at(costmap, 3.0, 1.0) == LETHAL
    assert cost_at(costmap, 3.0, 1.45) == LETHAL
    assert cost_at(costmap, 3.0, 1.6) == FREE
    assert cost_at(costmap, 3.0, 3.5) == UNKNOWN  # beyond the edge of the map
    assert not costmap.update(Pose(3.0, 1.0), (), (), here_from_map)


def test_what_lasers_see_stays_above_a_map_that_rolls() -> None:
    costmap = Costmap(replace(WINDOW, layers=(StaticConfig(), ObstacleConfig(sources=(LASER,)))))
    costmap.set_map(MAP)
    costmap.update(Pose(11.0, 21.0), (Observation(LASER, 11.0, 21.0, np.array([[12.0, 20.5]])),))
    costmap.update(Pose(11.2, 21.0), ())
    assert cost_at(costmap, 12.0, 20.5) == LETHAL


@pytest.mark.parametrize("yaw", [math.pi / 2, -0.4, 2.0])
def test_a_map_whose_origin_is_turned_lies_turned(yaw: float) -> None:
    cells = np.zeros((30, 40), np.int8)
    cells[20:24, 30:34] = 100
    grid = Grid(0.1, Pose(-3.0, 5.0, yaw), cells)
    costmap = Costmap(CostmapConfig(footprint=FOOTPRINT, layers=(StaticConfig(),)))
    costmap.set_map(grid)
    costmap.update(Pose(-3.0, 5.0), ())
    assert cost_at(costmap, *grid.point_at(21.5, 31.5)) == LETHAL
    assert cost_at(costmap, *grid.point_at(15.0, 31.5)) == FREE
    assert abs(int((costmap.cells == LETHAL).sum()) - 16) <= 4


def test_another_inflation_keeps_what_was_seen() -> None:
    layers = (ObstacleConfig(sources=(LASER,)), InflationConfig(inflation_radius=0.5))
    costmap = Costmap(replace(WINDOW, layers=layers))
    costmap.update(Pose(), (Observation(LASER, 0.0, 0.0, np.array([[1.5, 0.0]])),))
    costmap.configure(
        replace(
            costmap.config,
            layers=(layers[0], InflationConfig(inflation_radius=1.5, cost_scaling_factor=1.0)),
        )
    )
    costmap.update(Pose(), ())
    assert cost_at(costmap, 1.5, 0.0) == LETHAL
    assert cost_at(costmap, 1.5, 1.0) > FREE


def test_a_layer_that_is_switched_off_and_on_starts_over() -> None:
    layer = ObstacleConfig(sources=(LASER,))
    costmap = Costmap(replace(WINDOW, layers=(layer,)))
    costmap.update(Pose(), (Observation(LASER, 0.0, 0.0, np.array([[1.5, 0.0]])),))
    for enabled in (False, True):
        costmap.configure(replace(costmap.config, layers=(replace(layer, enabled=enabled),)))
        costmap.update(Pose(), ())
        assert not costmap.cells.any()


def test_another_size_of_the_window_holds_at_once() -> None:
    costmap = Costmap(replace(WINDOW, layers=(ObstacleConfig(),)))
    costmap.configure(replace(costmap.config, width=4.0))
    costmap.update(Pose(), ())
    assert costmap.cells.shape == (60, 40)


ROOM = grid_from_text(["####", "#..#", "#..#", "####"], 1.0)
KEEP_OUT = grid_from_text(["....", "...#", "....", "...."], 1.0)
OTHER_ROOM = grid_from_text(["#####", "#...#", "#####"], 1.0)
STATIC = StaticConfig(map_topic="map")
NO_GO = StaticConfig(map_topic="no_go", use_maximum=True)
SENSING = ObstacleConfig(sources=(LASER,))
MAPPED = CostmapConfig(footprint=FOOTPRINT, layers=(STATIC, SENSING, NO_GO))


def test_each_static_layer_has_the_map_of_its_own_topic() -> None:
    costmap = Costmap(MAPPED)
    costmap.set_map(ROOM, "map")
    assert costmap.missing_maps() == ["no_go"]
    costmap.set_map(KEEP_OUT, "no_go")
    assert costmap.ready
    costmap.update(Pose(1.5, 1.5), ())
    assert cost_at(costmap, 0.5, 0.5) == LETHAL
    assert cost_at(costmap, 3.5, 2.5) == LETHAL
    assert "in an obstacle" in costmap.goal_fault(Pose(3.5, 2.5))
    costmap.set_map(OTHER_ROOM, "map")
    costmap.update(Pose(1.5, 1.5), ())
    assert (costmap.geometry.rows, costmap.geometry.cols) == (3, 5)
    assert cost_at(costmap, 3.5, 2.5) == LETHAL


def test_a_static_layer_that_is_toggled_keeps_its_map_and_a_disabled_one_rules_out_no_goal() -> (
    None
):
    costmap = Costmap(MAPPED)
    costmap.set_map(ROOM, "map")
    costmap.set_map(KEEP_OUT, "no_go")
    off = replace(MAPPED, layers=(replace(STATIC, enabled=False), SENSING, NO_GO))
    costmap.configure(off)
    assert costmap.ready
    costmap.update(Pose(1.5, 1.5), ())
    assert cost_at(costmap, 0.5, 0.5) == FREE
    assert costmap.goal_fault(Pose(0.5, 0.5)) == ""
    costmap.configure(MAPPED)
    assert costmap.ready
    costmap.update(Pose(1.5, 1.5), ())
    assert cost_at(costmap, 0.5, 0.5) == LETHAL
    assert costmap.goal_fault(Pose(0.5, 0.5)) != ""


def test_a_layer_with_first_map_only_keeps_its_first_map() -> None:
    """The parameter was accepted and had no effect."""
    first_only = replace(STATIC, first_map_only=True)
    costmap = Costmap(replace(MAPPED, layers=(first_only, SENSING, NO_GO)))
    assert costmap.takes_map("map")
    costmap.set_map(ROOM, "map")
    costmap.set_map(KEEP_OUT, "no_go")
    assert not costmap.takes_map("map")
    assert costmap.takes_map("no_go")
    costmap.set_map(OTHER_ROOM, "map")
    costmap.update(Pose(1.5, 1.5), ())
    assert (costmap.geometry.rows, costmap.geometry.cols) == (4, 4)
    assert cost_at(costmap, 0.5, 3.5) == LETHAL


def test_the_same_map_again_keeps_what_sensors_have_seen() -> None:
    costmap = Costmap(replace(MAPPED, layers=(STATIC, SENSING)))
    costmap.set_map(ROOM)
    costmap.update(Pose(1.5, 1.5), (Observation(LASER, 1.5, 1.5, np.array([[2.6, 2.6]])),))
    costmap.set_map(grid_from_text(["####", "#..#", "#.##", "####"], 1.0))
    costmap.update(Pose(1.5, 1.5), ())
    assert cost_at(costmap, 2.5, 2.5) == LETHAL
    assert cost_at(costmap, 2.5, 1.5) == LETHAL
    costmap.set_map(OTHER_ROOM)
    costmap.update(Pose(1.5, 1.5), ())
    assert (costmap.cells == LETHAL).sum() == 12


@pytest.mark.parametrize("seed", range(20))
def test_a_costmap_after_any_changes_is_that_of_its_last_configuration_and_maps(seed: int) -> None:
    generator = np.random.default_rng(seed)
    costmap, config = Costmap(MAPPED), MAPPED
    maps: dict[str, Grid] = {}
    pose = Pose(1.5, 1.5)
    for _ in range(40):
        change = generator.integers(4)
        if change == 0:
            topic = str(generator.choice(["map", "no_go"]))
            maps[topic] = (ROOM, KEEP_OUT, OTHER_ROOM)[generator.integers(3)]
            costmap.set_map(maps[topic], topic)
        elif change == 1:
            index = int(generator.integers(3))
            layers = list(config.layers)
            layers[index] = replace(layers[index], enabled=not layers[index].enabled)
            config = replace(config, layers=tuple(layers))
            costmap.configure(config)
        elif change == 2:
            config = replace(config, width=float(generator.integers(3, 6)))
            costmap.configure(config)
        elif costmap.ready:
            costmap.update(pose, ())
        fresh = Costmap(config)
        for topic, grid in maps.items():
            fresh.set_map(grid, topic)
        assert costmap.ready == fresh.ready
        assert costmap.geometry == fresh.geometry
        if costmap.ready:
            fresh.update(pose, ())
            costmap.update(pose, ())
            assert np.array_equal(costmap.cells, fresh.cells)


def test_obstacles_as_wide_as_a_robot_are_found_as_by_comparing_all_pairs_of_cells() -> None:
    generator = np.random.default_rng(5)
    costmap = Costmap(CostmapConfig(layers=(StaticConfig(), SENSING)))
    costmap.set_map(Grid(0.05, Pose(), np.zeros((100, 100), np.int8)))
    for _ in range(10):
        centres = generator.uniform(0.5, 4.5, (3, 2))
        points = np.concatenate(
            [centre + generator.normal(0.0, 0.12, (12, 2)) for centre in centres]
        )
        costmap.reset()
        costmap.update(
            Pose(2.5, 2.5), (Observation(replace(LASER, clearing=False), 2.5, 2.5, points),)
        )
        costmap.update(Pose(2.5, 2.5), (Observation(LASER, 2.5, 2.5, points),))
        found = {tuple(point) for point in costmap.unmapped(Pose(2.5, 2.5), 4.0).round(3).tolist()}
        cells = np.argwhere(next(iter(costmap._obstacles.values())).cells == LETHAL)[:, ::-1]
        apart = np.square(cells[:, None] - cells[None]).sum(axis=2)  # [cells**2], exact
        wide = ((apart > (0.32 / 0.05) ** 2) & (apart <= 12**2)).any(axis=0)
        joined = apart < 6**2
        for _ in range(len(cells)):
            joined = joined @ joined
        extents = [np.square(np.ptp(cells[row], axis=0)).sum() for row in joined]
        expected = (cells[wide & (np.array(extents) < 24**2)] + 0.5) * 0.05
        assert found == {tuple(point) for point in expected.round(3).tolist()}


def test_unmapped_obstacles_on_a_fine_grid_take_little_memory() -> None:
    """Comparing all pairs of cells took 969 MB at a resolution of 1 cm."""
    laser = replace(LASER, clearing=False, obstacle_range=10.0)
    costmap = Costmap(CostmapConfig(layers=(StaticConfig(), ObstacleConfig(sources=(laser,)))))
    costmap.set_map(Grid(0.01, Pose(), np.zeros((600, 600), np.int8)))
    boxes = [(x, y) for x in (1.0, 2.0, 3.0, 4.0, 5.0) for y in (1.5, 3.0, 4.5)]
    side = np.arange(-0.2, 0.2, 0.01)
    filled = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    points = np.concatenate([filled + box for box in boxes])
    costmap.update(Pose(3.0, 0.5), (Observation(laser, 3.0, 0.5, points),))
    costmap.unmapped(Pose(3.0, 3.0), 4.0)
    tracemalloc.start()
    found = costmap.unmapped(Pose(3.0, 3.0), 4.0)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(found) > 10_000
    assert most < 30e6
