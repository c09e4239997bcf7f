"""move_base accepts the configuration, and its values are the ones that users of this robot know."""

from pathlib import Path
from typing import Any

import yaml

from nav_bundle.move_base.config import Setup, setup_from_parameters

CONFIG = Path(__file__).parents[2] / "config"


def read(name: str) -> dict[str, Any]:
    return yaml.safe_load((CONFIG / name).read_text())


def configured(local_planner: str = "base_local_planner/TrajectoryPlannerROS") -> Setup:
    """Returns the set-up from the files, merged as the launch file merges them."""
    common = read("costmap_common_params.yaml")
    parameters = {**read("base_local_planner_params.yaml"), **read("dwa_local_planner_params.yaml")}
    parameters["base_local_planner"] = local_planner
    for name in ("global_costmap", "local_costmap"):
        parameters[name] = {**common, **read(f"{name}_params.yaml")[name]}
    return setup_from_parameters(parameters, "/move_base")


def test_move_base_knows_every_parameter() -> None:
    assert configured().base.planner_frequency == 0.5


def test_the_local_planner_is_the_pioneers() -> None:
    planner = configured().local_planner
    assert (planner.max_vel_x, planner.min_vel_x, planner.escape_vel) == (1.0, 0.1, -0.2)
    assert (planner.max_vel_theta, planner.min_vel_theta, planner.min_in_place_vel_theta) == (
        1.0,
        -1.0,
        0.4,
    )
    assert (planner.acc_lim_theta, planner.acc_lim_x, planner.acc_lim_y) == (3.2, 2.5, 2.5)
    assert (planner.xy_goal_tolerance, planner.yaw_goal_tolerance) == (0.25, 3.15)
    assert (planner.sim_time, planner.heading_lookahead, planner.meter_scoring) == (
        1.7,
        0.325,
        True,
    )
    assert (planner.path_distance_bias, planner.goal_distance_bias) == (0.8, 1.0)


def test_the_other_local_planner_is_the_pioneers_too() -> None:
    planner = configured("dwa_local_planner/DWAPlannerROS").local_planner
    assert (planner.max_vel_x, planner.max_vel_trans, planner.min_vel_x) == (1.0, 1.0, 0.0)
    assert (planner.max_vel_y, planner.min_vel_y) == (0.0, 0.0)
    assert (planner.max_vel_theta, planner.min_vel_theta) == (1.0, 0.4)
    assert (planner.acc_lim_theta, planner.acc_lim_x) == (3.2, 2.5)
    assert (planner.xy_goal_tolerance, planner.yaw_goal_tolerance) == (0.25, 3.15)


def test_the_costmaps_are_the_pioneers() -> None:
    whole, window = configured().global_costmap, configured().local_costmap
    assert (whole.update_frequency, whole.publish_frequency, whole.rolling_window) == (
        5.0,
        1.0,
        False,
    )
    assert (window.update_frequency, window.publish_frequency, window.rolling_window) == (
        5.0,
        5.0,
        True,
    )
    assert (window.width, window.height, window.resolution) == (3.0, 3.0, 0.05)
    assert [layer.inflation_radius for layer in (whole.layers[-1], window.layers[-1])] == [1.5, 2.0]
    assert [layer.cost_scaling_factor for layer in (whole.layers[-1], window.layers[-1])] == [
        5.0,
        5.0,
    ]


def test_both_costmaps_see_the_laser() -> None:
    for costmap in (configured().global_costmap, configured().local_costmap):
        (source,) = (source for layer in costmap.layers for source in getattr(layer, "sources", ()))
        assert (source.topic, source.obstacle_range, source.raytrace_range) == (
            "base_scan",
            3.0,
            3.5,
        )
        assert (source.marking, source.clearing, source.expected_update_rate) == (True, True, 0.4)
