"""Parameters of TrajectoryPlannerROS, with base_local_planner's names."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, TypeVar

from pioneer_node.core.live import Live
from pioneer_node.core.parameter import (
    ONLY_LIVE,
    UNKNOWN,
    ParameterError,
    WithoutEffect,
    config_from_mapping,
)

Config = TypeVar("Config", bound=Any)

# Deprecated names that base_local_planner still accepts, and the current ones.
_FORMER = {
    "pdist_scale": "path_distance_bias",
    "gdist_scale": "goal_distance_bias",
    "acc_lim_th": "acc_lim_theta",
    "backup_vel": "escape_vel",
    "min_in_place_rotational_vel": "min_in_place_vel_theta",
    "max_rotational_vel": "max_vel_theta",
}

LOCAL_FRAME = WithoutEffect("is not used: the local costmap's ~global_frame counts")


@dataclass(frozen=True)
class TrajectoryConfig:
    """Parameters of TrajectoryPlannerROS; defaults are those effective in Noetic (dynamic_reconfigure's, if any).

    Speeds in [m/s] and [rad/s], accelerations in [m/s**2] and [rad/s**2], distances in [m], times in [s].
    ``heading_scoring`` scores a sample at ``heading_scoring_timestep``, and also by its heading to the farthest visible
    point of the plan. Not in Noetic: ``clearance`` [m] is the distance kept from obstacles where there is room, and
    ``clearance_scale`` is the cost of touching them all the way, in units of the biases; 0 gives base_local_planner's
    scores. With ``holonomic_robot`` the robot also drives sideways at ``y_vels`` [m/s], numbers in a text or a list.
    ``simple_attractor`` is not supported: setting it is an error.
    """

    acc_lim_x: Annotated[float, Live(0.0, 20.0)] = 2.5
    acc_lim_y: Annotated[float, Live(0.0, 20.0)] = 2.5
    acc_lim_theta: Annotated[float, Live(0.0, 20.0)] = 3.2
    max_vel_x: Annotated[float, Live(0.0, 20.0)] = 0.55
    min_vel_x: Annotated[float, Live(0.0, 20.0)] = 0.0
    max_vel_theta: Annotated[float, Live(0.0, 20.0)] = 1.0
    min_vel_theta: Annotated[float, Live(-20.0, 0.0)] = -1.0
    min_in_place_vel_theta: Annotated[float, Live(0.0, 20.0)] = 0.4
    escape_vel: Annotated[float, Live(-2.0, 2.0)] = -0.1
    holonomic_robot: Annotated[bool, Live()] = False
    xy_goal_tolerance: Annotated[float, Live(0.0)] = 0.10
    yaw_goal_tolerance: Annotated[float, Live(0.0)] = 0.05
    latch_xy_goal_tolerance: Annotated[bool, Live()] = False
    sim_time: Annotated[float, Live(0.0, 10.0)] = 1.7
    sim_granularity: Annotated[float, Live(0.0, 5.0)] = 0.025
    angular_sim_granularity: Annotated[float, Live(0.0, math.pi / 2)] = 0.025
    vx_samples: Annotated[int, Live(1, 300)] = 20
    vtheta_samples: Annotated[int, Live(1, 300)] = 20
    controller_frequency: float = 20.0
    meter_scoring: Annotated[bool, Live()] = False
    path_distance_bias: Annotated[float, Live(0.0, 5.0)] = 0.6
    goal_distance_bias: Annotated[float, Live(0.0, 5.0)] = 0.8
    occdist_scale: Annotated[float, Live(0.0, 5.0)] = 0.01
    clearance: Annotated[float, Live(0.0, 2.0)] = 0.4
    clearance_scale: Annotated[float, Live(0.0, 100.0)] = 14.0
    heading_lookahead: Annotated[float, Live(0.0, 5.0)] = 0.325
    dwa: Annotated[bool, Live()] = False
    prune_plan: Annotated[bool, Live()] = True
    oscillation_reset_dist: Annotated[float, Live(0.0, 5.0)] = 0.05
    escape_reset_dist: Annotated[float, Live(0.0, 5.0)] = 0.10
    escape_reset_theta: Annotated[float, Live(0.0, 5.0)] = math.pi / 2
    rot_stopped_velocity: float = 0.01
    trans_stopped_velocity: float = 0.01
    planner_frequency: Annotated[float, WithoutEffect("is not used: move_base's own counts")] = 0.0
    stop_time_buffer: Annotated[float, WithoutEffect("is read and not used, as in Noetic")] = 0.2
    simple_attractor: Annotated[bool, Live()] = False
    heading_scoring: Annotated[bool, Live()] = False
    heading_scoring_timestep: Annotated[float, Live(0.0, 1.0)] = 0.1
    publish_cost_grid_pc: Annotated[bool, Live()] = False
    restore_defaults: Annotated[bool, Live(), ONLY_LIVE] = False
    y_vels: Annotated[Any, Live()] = "-0.3,-0.1,0.1,0.3"
    world_model: Annotated[str, WithoutEffect("is not used: there is only 'costmap'")] = "costmap"
    global_frame_id: Annotated[str, LOCAL_FRAME] = ""

    def sideways(self) -> tuple[float, ...]:
        """Returns the speeds to the left [m/s] that a holonomic robot tries; none for another robot.

        Raises:
            ValueError: ``y_vels`` are not finite numbers.
        """
        texts = (
            self.y_vels.replace(",", " ").split() if isinstance(self.y_vels, str) else self.y_vels
        )
        try:
            speeds = tuple(float(text) for text in texts)
        except TypeError as error:
            raise ValueError(str(error)) from error
        if not all(math.isfinite(speed) for speed in speeds):
            raise ValueError("not finite")
        return speeds if self.holonomic_robot else ()

    def limited(self, speed: float, turn: float) -> "TrajectoryConfig":
        """Returns the configuration with at most these speeds [m/s] and [rad/s]; lower bounds give way."""
        return replace(
            self,
            max_vel_x=min(self.max_vel_x, speed),
            min_vel_x=min(self.min_vel_x, speed),
            max_vel_theta=min(self.max_vel_theta, turn),
            min_vel_theta=max(self.min_vel_theta, -turn),
            min_in_place_vel_theta=min(self.min_in_place_vel_theta, turn),
        )


def trajectory_config_from_parameters(
    parameters: Mapping[str, Any], owner: str, frequency: float
) -> TrajectoryConfig:
    """Returns the configuration in namespace ``owner``; ``frequency`` [Hz] is the default ``controller_frequency``.

    Raises:
        ParameterError: an unknown name, a wrong type, a value out of range, or an unsupported option.
    """
    values = {_FORMER.get(name, name): value for name, value in parameters.items()}
    if "max_rotational_vel" in parameters:
        values.setdefault("min_vel_theta", -parameters["max_rotational_vel"])
    if "sim_granularity" in values:
        values.setdefault("angular_sim_granularity", values["sim_granularity"])
    values.setdefault("controller_frequency", frequency)
    config = with_samples(
        config_from_mapping(TrajectoryConfig, values, owner),
        ("vx_samples", "vtheta_samples"),
        owner,
    )
    _check(config, owner)
    return config


def with_samples(config: Config, names: Sequence[str], owner: str) -> Config:
    """Returns ``config`` with at least one sample in each of these directions, as base_local_planner corrects it."""
    corrected = {}
    for name in names:
        if getattr(config, name) < 1:
            UNKNOWN.correct(f"{owner}: ~{name} is {getattr(config, name)}, taken as 1")
            corrected[name] = 1
    return replace(config, **corrected)


def _check(config: TrajectoryConfig, owner: str) -> None:
    if config.simple_attractor:
        raise ParameterError(f"{owner}: ~simple_attractor true is not available")
    try:
        config.sideways()
    except ValueError:
        raise ParameterError(
            f"{owner}: ~y_vels must be speeds separated by commas, not {config.y_vels!r}"
        ) from None
    for name in (
        "sim_time",
        "sim_granularity",
        "angular_sim_granularity",
        "controller_frequency",
        "acc_lim_x",
    ):
        if not getattr(config, name) > 0.0:
            raise ParameterError(f"{owner}: ~{name} must be positive, not {getattr(config, name)}")
    for axis in ("x", "theta"):
        low, high = getattr(config, f"min_vel_{axis}"), getattr(config, f"max_vel_{axis}")
        if low > high:
            raise ParameterError(
                f"{owner}: ~min_vel_{axis} must be at most ~max_vel_{axis} ({low} > {high})"
            )
    if config.escape_vel > 0.0:
        UNKNOWN.correct(
            f"{owner}: ~escape_vel is {config.escape_vel}: it leads forward instead of backward"
        )
