"""Parameters of DWAPlannerROS, with dwa_local_planner's names."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

from nav_bundle.control.trajectory_config import LOCAL_FRAME, with_samples
from pioneer_node.core.live import Live
from pioneer_node.core.parameter import (
    ONLY_LIVE,
    UNKNOWN,
    ParameterError,
    WithoutEffect,
    config_from_mapping,
)

# Deprecated names that dwa_local_planner still accepts, and the current ones.
_FORMER = {
    "max_trans_vel": "max_vel_trans",
    "min_trans_vel": "min_vel_trans",
    "max_rot_vel": "max_vel_theta",
    "min_rot_vel": "min_vel_theta",
    "acc_limit_trans": "acc_lim_trans",
    "rot_stopped_vel": "theta_stopped_vel",
}
_AS_IN_NOETIC = "is read and not used, as in Noetic"
_FOOTPRINT = "is not used: the footprint does not grow with the speed"


@dataclass(frozen=True)
class DwaConfig:
    """Parameters of DWAPlannerROS; defaults are Noetic's.

    Speeds in [m/s] and [rad/s], accelerations in [m/s**2] and [rad/s**2], distances in [m], angles in [rad], times
    in [s]. ``path_distance_bias`` and ``goal_distance_bias`` are weights per metre. ``publish_traj_pc`` is not
    supported and is reported as such. Not in Noetic: ``clearance`` and ``clearance_scale``, see ``TrajectoryConfig``.
    """

    max_vel_trans: Annotated[float, Live(0.0)] = 0.55
    min_vel_trans: Annotated[float, Live(0.0)] = 0.1
    max_vel_x: Annotated[float, Live()] = 0.55
    min_vel_x: Annotated[float, Live()] = 0.0
    max_vel_y: Annotated[float, Live()] = 0.1
    min_vel_y: Annotated[float, Live()] = -0.1
    max_vel_theta: Annotated[float, Live(0.0)] = 1.0
    min_vel_theta: Annotated[float, Live(0.0)] = 0.4
    acc_lim_x: Annotated[float, Live(0.0, 20.0)] = 2.5
    acc_lim_y: Annotated[float, Live(0.0, 20.0)] = 2.5
    acc_lim_theta: Annotated[float, Live(0.0, 20.0)] = 3.2
    acc_lim_trans: Annotated[float, Live(0.0), WithoutEffect(_AS_IN_NOETIC)] = 0.1
    prune_plan: Annotated[bool, Live()] = False
    xy_goal_tolerance: Annotated[float, Live(0.0)] = 0.1
    yaw_goal_tolerance: Annotated[float, Live(0.0)] = 0.1
    latch_xy_goal_tolerance: Annotated[bool, Live()] = False
    trans_stopped_vel: Annotated[float, Live(0.0)] = 0.1
    theta_stopped_vel: Annotated[float, Live(0.0)] = 0.1
    sim_time: Annotated[float, Live(0.0)] = 1.7
    sim_granularity: Annotated[float, Live(0.0)] = 0.025
    angular_sim_granularity: Annotated[float, Live(0.0)] = 0.1
    path_distance_bias: Annotated[float, Live(0.0)] = 0.6
    goal_distance_bias: Annotated[float, Live(0.0)] = 0.8
    occdist_scale: Annotated[float, Live(0.0)] = 0.01
    twirling_scale: Annotated[float, Live(0.0)] = 0.0
    clearance: Annotated[float, Live(0.0, 2.0)] = 0.4
    clearance_scale: Annotated[float, Live(0.0)] = 10.0
    stop_time_buffer: Annotated[float, Live(0.0), WithoutEffect(_AS_IN_NOETIC)] = 0.2
    oscillation_reset_dist: Annotated[float, Live(0.0)] = 0.05
    oscillation_reset_angle: Annotated[float, Live(0.0)] = 0.2
    forward_point_distance: Annotated[float, Live()] = 0.325
    cheat_factor: float = 1.0
    scaling_speed: Annotated[float, Live(0.0), WithoutEffect(_FOOTPRINT)] = 0.25
    max_scaling_factor: Annotated[float, Live(0.0), WithoutEffect(_FOOTPRINT)] = 0.2
    vx_samples: Annotated[int, Live(1, 300)] = 3
    vy_samples: Annotated[int, Live(1, 300)] = 10
    vth_samples: Annotated[int, Live(1, 300)] = 20
    use_dwa: Annotated[bool, Live()] = True
    controller_frequency: float = 20.0
    publish_traj_pc: Annotated[bool, Live()] = False
    publish_cost_grid_pc: Annotated[bool, Live()] = False
    restore_defaults: Annotated[bool, Live(), ONLY_LIVE] = False
    global_frame_id: Annotated[str, LOCAL_FRAME] = ""

    def limited(self, speed: float, turn: float) -> "DwaConfig":
        """Returns the configuration with at most these speeds [m/s] and [rad/s]; lower bounds give way."""
        return replace(
            self,
            max_vel_trans=min(self.max_vel_trans, speed),
            min_vel_trans=min(self.min_vel_trans, speed),
            max_vel_x=min(self.max_vel_x, speed),
            min_vel_x=min(max(self.min_vel_x, -speed), speed),
            max_vel_theta=min(self.max_vel_theta, turn),
            min_vel_theta=min(self.min_vel_theta, turn),
        )


def dwa_config_from_parameters(
    parameters: Mapping[str, Any], owner: str, frequency: float
) -> DwaConfig:
    """Returns the configuration in namespace ``owner``; ``frequency`` [Hz] is the default ``controller_frequency``.

    Raises:
        ParameterError: an unknown name, a wrong type, a value out of range, or an unsupported option.
    """
    values = {_FORMER.get(name, name): value for name, value in parameters.items()}
    values.setdefault("controller_frequency", frequency)
    config = config_from_mapping(DwaConfig, values, owner)
    config = with_samples(config, ("vx_samples", "vy_samples", "vth_samples"), owner)
    _check(config, owner)
    return config


def _check(config: DwaConfig, owner: str) -> None:
    if config.publish_traj_pc:
        UNKNOWN.complain(f"{owner}: ~publish_traj_pc true is not available")
    positive = (
        "sim_time",
        "sim_granularity",
        "angular_sim_granularity",
        "controller_frequency",
        "acc_lim_x",
    )
    for name in (*positive, "acc_lim_theta"):
        if not getattr(config, name) > 0.0:
            raise ParameterError(f"{owner}: ~{name} must be positive, not {getattr(config, name)}")
    for name in ("path_distance_bias", "goal_distance_bias", "occdist_scale", "twirling_scale"):
        if getattr(config, name) < 0.0:
            raise ParameterError(
                f"{owner}: ~{name} must not be negative, not {getattr(config, name)}"
            )
    for axis in ("x", "y"):
        low, high = getattr(config, f"min_vel_{axis}"), getattr(config, f"max_vel_{axis}")
        if low > high:
            raise ParameterError(
                f"{owner}: ~min_vel_{axis} must be at most ~max_vel_{axis} ({low} > {high})"
            )
