"""Parameters as published robots write them: taken as Noetic takes them, or warned of with the name and the reason."""

import contextlib
import random
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from nav_bundle.control.dwa_config import DwaConfig
from nav_bundle.control.trajectory_config import TrajectoryConfig
from nav_bundle.costmap.config import (
    CostmapConfig,
    InflationConfig,
    ObstacleConfig,
    StaticConfig,
    costmap_config_from_parameters,
)
from nav_bundle.costmap.footprint import FootprintError, footprint_from_parameters
from nav_bundle.mapping.config import GmappingConfig
from nav_bundle.move_base.config import MoveBaseConfig, setup_from_parameters
from pioneer_node.core.parameter import UNKNOWN, ParameterError

STATIC = {"name": "static_layer", "type": "costmap_2d::StaticLayer"}
OBSTACLES = {"name": "obstacle_layer", "type": "costmap_2d::ObstacleLayer"}
INFLATION = {"name": "inflation_layer", "type": "costmap_2d::InflationLayer"}


@pytest.fixture(autouse=True)
def warnings_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets each test see the warnings that are given once a process."""
    monkeypatch.setattr(UNKNOWN, "_reported", set())


def costmap(**parameters: Any) -> CostmapConfig:
    return costmap_config_from_parameters(parameters, "costmap")


@pytest.mark.parametrize(
    "text",
    [
        "[[.3,.2],[.3,-.2],[-.3,0.]]",
        "[ [0.3, 0.2] , [0.3, -0.2] , [-0.3, 0] ]",
        "[[+0.3, .2], [3e-1, -.2], [-.3, 0.],]",
        "[[0.3 0.2] [0.3 -0.2] [-0.3 0]]",
        "[[0.3,0.2],\n [0.3,-0.2],\n\t[-0.3,0.0]]",
    ],
)
def test_a_footprint_s_text_is_read_as_leniently_as_by_costmap_2d(text: str) -> None:
    vertices = footprint_from_parameters(text, 0.0, 0.0).vertices
    np.testing.assert_allclose(vertices, [[0.3, 0.2], [0.3, -0.2], [-0.3, 0.0]])


@pytest.mark.parametrize(
    "text",
    [
        "[[1, 2], [3, 4]",
        "[[1, 2], [3, 4]]",
        "[[[1, 2], [3, 4], [5, 6]]]",
        "1, 2, 3",
        "[[a, 2], [3, 4], [5, 6]]",
        "][",
    ],
)
def test_a_footprint_s_text_that_is_no_outline_is_refused_with_the_text(text: str) -> None:
    with pytest.raises(FootprintError, match="footprint must"):
        footprint_from_parameters(text, 0.0, 0.0)


def test_a_footprint_in_move_base_s_namespace_is_that_of_both_costmaps() -> None:
    outline = [[0.488, -0.293], [0.488, 0.293], [-0.412, 0.293], [-0.412, -0.293]]
    setup = setup_from_parameters(
        {"footprint": outline, "global_costmap": {"static_map": True}}, "move_base"
    )
    for config in (setup.global_costmap, setup.local_costmap):
        assert config.footprint == outline


def test_a_costmap_s_own_footprint_counts_before_the_one_above() -> None:
    own = [[1, 0], [0, 1], [-1, -1]]
    above = {"footprint": [[2, 0], [0, 2], [-2, -2]], "robot_radius": 3.0}
    config = costmap_config_from_parameters({"footprint": own}, "costmap", above)
    assert config.footprint == own
    assert config.robot_radius == 3.0


def test_layers_of_a_list_take_parameters_from_the_costmap_s_namespace() -> None:
    config = costmap(
        inflation_radius=1.5, cost_scaling_factor=1.0, map_topic="/other", max_obstacle_height=0.6,
        plugins=[STATIC, OBSTACLES, INFLATION],
    )  # fmt: skip
    static, obstacles, inflation = config.layers
    assert isinstance(static, StaticConfig)
    assert isinstance(obstacles, ObstacleConfig)
    assert isinstance(inflation, InflationConfig)
    assert static.map_topic == "/other"
    assert obstacles.max_obstacle_height == 0.6
    assert (inflation.inflation_radius, inflation.cost_scaling_factor) == (1.5, 1.0)


def test_a_layer_s_own_value_counts_and_the_other_one_is_named(
    caplog: pytest.LogCaptureFixture,
) -> None:
    config = costmap(
        inflation_radius=1.5, inflation_layer={"inflation_radius": 0.4}, plugins=[INFLATION]
    )
    (inflation,) = config.layers
    assert isinstance(inflation, InflationConfig)
    assert inflation.inflation_radius == 0.4
    assert (
        "~inflation_radius is 1.5, but ~inflation_layer/inflation_radius is 0.4 and counts"
        in caplog.text
    )


@pytest.mark.parametrize(
    "name", ["static_map", "map_type", "observation_sources", "inflate_unknown"]
)
def test_what_no_layer_of_a_list_reads_in_the_costmap_s_namespace_is_named(
    name: str, caplog: pytest.LogCaptureFixture
) -> None:
    costmap(**{name: "x", "plugins": [STATIC]})
    assert f"~{name} is read only without a list of plugins" in caplog.text


@pytest.mark.parametrize(
    ("layer", "wrong", "near"),
    [
        ("inflation_layer", "inflation_radiuss", "inflation_radius"),
        ("obstacle_layer", "combination_methd", "combination_method"),
        ("static_layer", "map_topik", "map_topic"),
    ],
)
def test_a_misspelt_name_inside_a_layer_is_named_in_both_styles(
    layer: str, wrong: str, near: str, caplog: pytest.LogCaptureFixture
) -> None:
    expected = f"costmap/{layer}: unknown parameter ~{wrong}; did you mean ~{near}?"
    costmap(**{layer: {wrong: 1}}, static_map=True)
    assert expected in caplog.text
    caplog.clear()
    UNKNOWN._reported.clear()
    costmap(**{layer: {wrong: 1}}, plugins=[STATIC, OBSTACLES, INFLATION])
    assert expected in caplog.text


def test_a_layer_may_have_the_name_of_a_parameter() -> None:
    config = costmap(
        static_map=True, plugins=[{"name": "static_map", "type": "costmap_2d::StaticLayer"}]
    )
    assert config.layer_names == ("static_map",)


def test_observation_sources_may_be_a_list() -> None:
    sources = {"scan": {"topic": "base_scan"}, "bump": {"topic": "bumper"}}
    config = costmap(observation_sources=["scan", "bump"], **sources)
    assert [source.topic for source in config.layers[0].sources] == ["base_scan", "bumper"]  # type: ignore[union-attr]


@pytest.mark.parametrize("name", ["vx_samples", "vy_samples", "vth_samples"])
def test_dwa_takes_no_samples_in_a_direction_as_one(
    name: str, caplog: pytest.LogCaptureFixture
) -> None:
    parameters = {
        "base_local_planner": "dwa_local_planner/DWAPlannerROS",
        "DWAPlannerROS": {name: 0},
    }
    planner = setup_from_parameters(parameters, "move_base").local_planner
    assert getattr(planner, name) == 1
    assert f"~{name} is 0, taken as 1" in caplog.text


def test_a_positive_escape_velocity_is_taken_and_named(caplog: pytest.LogCaptureFixture) -> None:
    parameters = {"TrajectoryPlannerROS": {"escape_vel": 0.1, "vx_samples": -3}}
    planner = setup_from_parameters(parameters, "move_base").local_planner
    assert (planner.escape_vel, planner.vx_samples) == (0.1, 1)
    assert "~escape_vel is 0.1: it leads forward instead of backward" in caplog.text


def test_gmapping_takes_thresholds_that_are_always_exceeded() -> None:
    config = GmappingConfig(linearUpdate=-1.0, angularUpdate=0.0, map_update_interval=0.0)
    assert (config.linearUpdate, config.map_update_interval) == (-1.0, 0.0)


VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 254, 10**9, 0.0, -0.5, 1e300, "", "x", "1", "true", [], [1], [[1, 2]], ["a", "b"],
    {}, {"name": "x"}, {"type": 3}, [{"name": "x"}], [STATIC], [None], {"topic": 3}, {"enabled": "maybe"},
)  # fmt: skip
NAMES = tuple(
    {
        field.name
        for kind in (CostmapConfig, StaticConfig, ObstacleConfig, InflationConfig)
        for field in fields(kind)
    }
    | {
        "plugins",
        "observation_sources",
        "scan",
        "static_layer",
        "obstacle_layer",
        "inflation_layer",
        "fleet_layer",
    }
    | {"static_map", "map_type", "z_voxels"}
)
TOP = tuple(
    {field.name for field in fields(MoveBaseConfig)}
    | {
        "TrajectoryPlannerROS",
        "DWAPlannerROS",
        "NavfnROS",
        "footprint",
        "robot_radius",
        "global_costmap",
    }
    | {"conservative_reset", "rotate_recovery"}
)
PLANNER = tuple({field.name for kind in (TrajectoryConfig, DwaConfig) for field in fields(kind)})


def drawn(names: tuple[str, ...], source: random.Random) -> Mapping[str, Any]:
    return {source.choice(names): source.choice(VALUES) for _ in range(source.randint(0, 5))}


@pytest.mark.parametrize("seed", range(8))
def test_no_configuration_ends_in_a_traceback(seed: int) -> None:
    source = random.Random(seed)
    for _ in range(300):
        parameters: dict[str, Any] = {
            **drawn(TOP, source),
            "local_costmap": drawn(NAMES, source),
            "TrajectoryPlannerROS": drawn(PLANNER, source),
        }
        with contextlib.suppress(ParameterError, FootprintError):
            setup_from_parameters(parameters, "move_base")
