"""Changes by dynamic_reconfigure pass the same checks as the parameters at start-up."""

import pytest

from nav_bundle.costmap.config import InflationConfig, costmap_config_from_parameters
from nav_bundle.localisation.config import AmclConfig
from nav_bundle.move_base.config import changed_parameters, setup_from_parameters
from pioneer_node.core.live import live_parameters, live_values
from pioneer_node.core.parameter import ParameterError

PARAMETERS = {
    "TrajectoryPlannerROS": {"acc_lim_th": 1.0, "sim_granularity": 0.1},
    "global_costmap": {"static_map": True, "inflation_radius": 1.5},
    "local_costmap": {
        "rolling_window": True,
        "plugins": [{"name": "around", "type": "costmap_2d::InflationLayer"}],
        "around": {"inflation_radius": 2.0},
    },
}
SETUP = setup_from_parameters(PARAMETERS, "/move_base")


def changed(namespace, **changes):
    return setup_from_parameters(
        changed_parameters(PARAMETERS, SETUP, namespace, changes), "/move_base"
    )


def test_every_part_of_move_base_has_noetics_namespace():
    assert list(SETUP.live_configs()) == [
        "",
        "TrajectoryPlannerROS",
        "global_costmap",
        "global_costmap/static_layer",
        "global_costmap/obstacle_layer",
        "global_costmap/inflation_layer",
        "local_costmap",
        "local_costmap/around",
    ]


@pytest.mark.parametrize("namespace", SETUP.live_configs())
def test_writing_out_what_holds_changes_nothing(namespace):
    assert changed(namespace).live_configs() == SETUP.live_configs()


@pytest.mark.parametrize("config", SETUP.live_configs().values(), ids=list(SETUP.live_configs()))
def test_defaults_lie_within_their_bounds(config):
    for parameter in live_parameters(type(config)):
        assert parameter.clamped(parameter.default) == parameter.default


@pytest.mark.parametrize("costmap", ["global_costmap/inflation_layer", "local_costmap/around"])
def test_a_layer_is_changed_in_classic_and_in_layered_style(costmap):
    layer = changed(costmap, inflation_radius=0.7).live_configs()[costmap]
    assert isinstance(layer, InflationConfig)
    assert layer.inflation_radius == 0.7


def test_a_former_name_does_not_win_over_a_change():
    assert SETUP.local_planner.acc_lim_theta == 1.0
    assert changed("TrajectoryPlannerROS", acc_lim_theta=2.0).local_planner.acc_lim_theta == 2.0


def test_a_default_that_follows_another_parameter_stays_where_it_is():
    assert (
        changed("TrajectoryPlannerROS", sim_granularity=0.2).local_planner.angular_sim_granularity
        == 0.1
    )


def test_the_other_local_planner_can_be_chosen():
    setup = changed("", base_local_planner="dwa_local_planner/DWAPlannerROS")
    assert (setup.local_planner_name, setup.drives_as(SETUP)) == ("DWAPlannerROS", False)
    assert live_values(setup.local_planner)["vth_samples"] == 20


def test_values_that_contradict_each_other_are_refused():
    with pytest.raises(ParameterError, match="~min_vel_x must be at most ~max_vel_x"):
        changed("TrajectoryPlannerROS", min_vel_x=2.0)


KNOWN = ("dwa_local_planner/DWAPlannerROS", "global_planner/GlobalPlanner")
LIMITS = (
    "max_vel_trans min_vel_trans max_vel_x min_vel_x max_vel_y min_vel_y max_vel_theta min_vel_theta acc_lim_x "
    "acc_lim_y acc_lim_theta acc_lim_trans prune_plan xy_goal_tolerance yaw_goal_tolerance trans_stopped_vel "
    "theta_stopped_vel restore_defaults"
)
"""Of base_local_planner's local_planner_limits."""
NOETIC = {
    "TrajectoryPlannerROS": (
        "acc_lim_x acc_lim_y acc_lim_theta max_vel_x min_vel_x max_vel_theta min_vel_theta min_in_place_vel_theta "
        "sim_time sim_granularity angular_sim_granularity path_distance_bias goal_distance_bias occdist_scale "
        "oscillation_reset_dist escape_reset_dist escape_reset_theta vx_samples vtheta_samples heading_lookahead "
        "holonomic_robot escape_vel dwa heading_scoring heading_scoring_timestep simple_attractor y_vels "
        "restore_defaults"
    ),
    "": (
        "base_global_planner base_local_planner planner_frequency controller_frequency planner_patience "
        "controller_patience max_planning_retries conservative_reset_dist recovery_behavior_enabled "
        "clearing_rotation_allowed shutdown_costmaps oscillation_timeout oscillation_distance restore_defaults"
    ),
    "local_costmap": (
        "transform_tolerance update_frequency publish_frequency width height resolution origin_x origin_y footprint "
        "robot_radius footprint_padding"
    ),
    "DWAPlannerROS": LIMITS
    + (
        " sim_time sim_granularity angular_sim_granularity path_distance_bias goal_distance_bias occdist_scale "
        "twirling_scale stop_time_buffer oscillation_reset_dist oscillation_reset_angle forward_point_distance "
        "scaling_speed max_scaling_factor vx_samples vy_samples vth_samples use_dwa"
    ),
    "GlobalPlanner": (
        "lethal_cost neutral_cost cost_factor publish_potential orientation_mode orientation_window_size"
    ),
    "local_costmap/static_layer": "enabled",
    "local_costmap/inflation_layer": "enabled cost_scaling_factor inflation_radius inflate_unknown",
    "local_costmap/obstacle_layer": "enabled footprint_clearing_enabled max_obstacle_height combination_method",
}
"""Names in the .cfg files of navigation's packages, by namespace."""


AMCL = (
    "min_particles max_particles kld_err kld_z update_min_d update_min_a resample_interval transform_tolerance "
    "recovery_alpha_slow recovery_alpha_fast do_beamskip beam_skip_distance beam_skip_threshold "
    "beam_skip_error_threshold tf_broadcast force_update_after_initialpose force_update_after_set_map "
    "gui_publish_rate save_pose_rate use_map_topic first_map_only laser_min_range laser_max_range laser_max_beams "
    "laser_z_hit laser_z_short laser_z_max laser_z_rand laser_sigma_hit laser_lambda_short "
    "laser_likelihood_max_dist laser_model_type odom_model_type odom_alpha1 odom_alpha2 odom_alpha3 odom_alpha4 "
    "odom_alpha5 odom_frame_id base_frame_id global_frame_id selective_resampling restore_defaults"
)


@pytest.mark.parametrize("namespace", NOETIC)
def test_every_name_of_noetics_cfg_files_can_be_changed(namespace: str) -> None:
    planners = {
        "base_local_planner": f"dwa_local_planner/{namespace}",
        "base_global_planner": f"global_planner/{namespace}",
    }
    chosen = {key: value for key, value in planners.items() if value in KNOWN}
    layers = {"local_costmap": {"static_map": True}}
    configs = setup_from_parameters({**chosen, **layers}, "move_base").live_configs()
    assert not set(NOETIC[namespace].split()) - live_values(configs[namespace]).keys()


def test_every_name_of_noetics_amcl_can_be_changed() -> None:
    assert not set(AMCL.split()) - live_values(AmclConfig()).keys()


@pytest.mark.parametrize("costmap", ["global_costmap", "local_costmap"])
def test_a_costmaps_size_is_a_whole_number_of_metres_to_clients(costmap: str) -> None:
    held = live_values(changed(costmap, width=7).live_configs()[costmap])
    assert (held["width"], type(held["width"]), type(held["height"])) == (7, int, int)


@pytest.mark.parametrize("size", [{"width": 2e6, "height": 2e6}, {"resolution": 1e-7}])
def test_a_costmap_of_terabytes_is_refused_before_it_is_built(size: dict[str, float]) -> None:
    """A reconfiguration to such a size ended in a MemoryError, half adopted."""
    with pytest.raises(ParameterError, match=r"~width, ~height and ~resolution give .* cells"):
        costmap_config_from_parameters(size, "/move_base/local_costmap")
