"""The voxel layer: what is seen at one height is not cleared at another; planar scans mark as in the obstacle layer."""

import math

import numpy as np
import pytest

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.config import VoxelConfig, costmap_config_from_parameters
from nav_bundle.costmap.cost import FREE, LETHAL, UNKNOWN
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.layer import Observation
from pioneer_node.core.parameter import ParameterError

SOURCES = {
    "observation_sources": "laser cloud",
    "laser": {"topic": "scan", "marking": True, "clearing": True},
    "cloud": {"topic": "points", "data_type": "PointCloud2", "marking": True, "clearing": False},
}
SHARED = {"rolling_window": True, "width": 8.0, "height": 8.0, "robot_radius": 0.2}


def costmap_of(kind: str = "Voxel", **layer: object) -> Costmap:
    parameters = {
        **SHARED,
        "plugins": [{"name": "layer", "type": f"costmap_2d::{kind}Layer"}],
        "layer": {**SOURCES, **layer},
    }
    costmap = Costmap(costmap_config_from_parameters(parameters, "costmap"))
    costmap.update(Pose(), [])
    return costmap


def seen(
    costmap: Costmap, source: int, *points: tuple[float, float, float], height: float = 0.3
) -> Observation:
    """Returns what the ``source`` at the origin, at ``height`` [m], sees."""
    found = np.array(points, np.float64).reshape(-1, 3)
    config = costmap.config.layers[0].sources[source]  # type: ignore[union-attr]
    flat = np.ascontiguousarray(found[:, :2])
    return Observation(config, 0.0, 0.0, flat, 0.0, height, found[:, 2].copy())


def cost(costmap: Costmap, x: float, y: float) -> int:
    return costmap.cost_of_cell(x, y)


def test_a_table_is_not_cleared_by_a_laser_that_looks_under_it() -> None:
    for kind, expected in (("Voxel", LETHAL), ("Obstacle", FREE)):
        costmap = costmap_of(kind)
        costmap.update(Pose(), [seen(costmap, 1, (1.0, 0.0, 0.75))])
        assert cost(costmap, 1.0, 0.0) == LETHAL
        costmap.update(Pose(), [seen(costmap, 0, (2.0, 0.0, 0.3))])
        assert cost(costmap, 1.0, 0.0) == expected, kind
        assert cost(costmap, 2.0, 0.0) == LETHAL


def test_a_ray_at_the_same_height_clears() -> None:
    costmap = costmap_of()
    costmap.update(Pose(), [seen(costmap, 0, (1.0, 0.0, 0.3))])
    costmap.update(Pose(), [seen(costmap, 0, (2.0, 0.0, 0.3))])
    assert cost(costmap, 1.0, 0.0) == FREE


def test_a_ray_that_leads_upwards_clears_only_what_it_crosses() -> None:
    costmap = costmap_of()
    low, high = (1.0, 0.0, 0.1), (1.0, 0.0, 0.9)
    costmap.update(Pose(), [seen(costmap, 1, low, high)])
    costmap.update(Pose(), [seen(costmap, 0, (2.0, 0.0, 1.7), height=0.1)])
    layer = costmap._obstacles[0]
    row, col = costmap.geometry.cell_at(1.0, 0.0)
    assert int(layer.marked[row, col]) == 1  # type: ignore[attr-defined]


def test_a_wall_that_is_still_seen_beyond_the_obstacle_range_is_kept() -> None:
    laser = {"topic": "scan", "clearing": True, "obstacle_range": 2.0, "raytrace_range": 3.0}
    costmap = costmap_of(laser=laser)
    costmap.update(Pose(), [seen(costmap, 1, (2.4, 0.0, 0.3))])
    costmap.update(Pose(), [seen(costmap, 0, (2.4, 0.0, 0.3))])
    assert cost(costmap, 2.4, 0.0) == LETHAL
    costmap.update(Pose(), [seen(costmap, 0, (2.7, 0.0, 0.3))])
    assert cost(costmap, 2.4, 0.0) == FREE


@pytest.mark.parametrize(("threshold", "expected"), [(0, LETHAL), (1, LETHAL), (2, FREE)])
def test_a_column_is_an_obstacle_above_the_mark_threshold(threshold: int, expected: int) -> None:
    costmap = costmap_of(mark_threshold=threshold)
    costmap.update(Pose(), [seen(costmap, 1, (1.0, 0.0, 0.1), (1.0, 0.0, 0.5))])
    assert cost(costmap, 1.0, 0.0) == expected


def test_a_column_is_unknown_above_the_unknown_threshold() -> None:
    costmap = costmap_of(unknown_threshold=8, track_unknown_space=True)
    costmap.update(Pose(), [seen(costmap, 0, (2.0, 0.0, 0.3))])
    cell = costmap.geometry.cell_at(1.0, 0.0)
    assert costmap._obstacles[0].cells[cell] == UNKNOWN, "nine of ten voxels are unknown"
    costmap.update(Pose(), [seen(costmap, 0, (2.0, 0.0, 0.7), height=0.7)])
    assert costmap._obstacles[0].cells[cell] == FREE


def test_points_above_the_columns_are_no_obstacles_and_those_below_count_for_the_lowest_voxel() -> (
    None
):
    costmap = costmap_of(origin_z=0.2, z_voxels=2)
    costmap.update(Pose(), [seen(costmap, 1, (1.0, 0.0, 0.7), (1.5, 0.0, 0.05))])
    assert (cost(costmap, 1.0, 0.0), cost(costmap, 1.5, 0.0)) == (FREE, LETHAL)


def test_columns_move_with_the_window_and_are_cleared_with_it() -> None:
    costmap = costmap_of()
    costmap.update(Pose(), [seen(costmap, 1, (1.0, 0.0, 0.75))])
    costmap.update(Pose(0.5, 0.5), [])
    costmap.update(Pose(0.5, 0.5), [seen(costmap, 0, (2.0, 0.0, 0.3))])
    assert cost(costmap, 1.0, 0.0) == LETHAL
    costmap.clear_inside(Pose(), 6.0)
    costmap.update(Pose(0.5, 0.5), [])
    assert cost(costmap, 1.0, 0.0) == FREE
    assert not costmap._obstacles[0].marked.any()  # type: ignore[attr-defined]


@pytest.mark.parametrize("seed", range(20))
def test_planar_scans_mark_as_in_the_obstacle_layer(seed: int) -> None:
    generator = np.random.default_rng(seed)
    costmaps = costmap_of("Voxel"), costmap_of("Obstacle")
    for _ in range(4):
        ranges = generator.uniform(0.4, 2.4, 90)
        angles = np.linspace(-math.pi, math.pi, 90)
        points = np.column_stack(
            [ranges * np.cos(angles), ranges * np.sin(angles), np.full(90, 0.3)]
        )
        for costmap in costmaps:
            costmap.update(Pose(), [seen(costmap, 0, *map(tuple, points))])
    voxels, obstacles = (costmap.cells == LETHAL for costmap in costmaps)
    last = costmaps[0].geometry
    for x, y, _ in points:
        assert voxels[last.cell_at(x, y)]
    # Lines through cells differ by a cell at most.
    assert (voxels != obstacles).mean() < 0.002


def test_map_type_voxel_makes_the_classic_obstacle_layer_one_of_voxels() -> None:
    config = costmap_config_from_parameters(
        {"map_type": "voxel", "z_voxels": 16, "origin_z": 0.1, **SOURCES}, "costmap"
    )
    layer = config.layers[0]
    assert isinstance(layer, VoxelConfig)
    assert (layer.z_voxels, layer.origin_z, len(layer.sources)) == (16, 0.1, 2)


def test_more_voxels_than_a_column_holds_are_corrected(caplog: pytest.LogCaptureFixture) -> None:
    config = costmap_config_from_parameters({"map_type": "voxel", "z_voxels": 20}, "voxel_costmap")
    assert config.layers[0].z_voxels == 16  # type: ignore[union-attr]
    assert "~z_voxels is 20, taken as 16" in caplog.text


def test_a_layer_that_nobody_has_is_named_with_what_to_do() -> None:
    plugin = {"name": "sonar", "type": "range_sensor_layer/RangeSensorLayer"}
    with pytest.raises(ParameterError, match="as PointCloud2 to an obstacle layer"):
        costmap_config_from_parameters({"plugins": [plugin]}, "costmap")
