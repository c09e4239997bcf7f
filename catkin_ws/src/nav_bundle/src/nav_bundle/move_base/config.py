"""Parameters of move_base, with their Noetic names."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, is_dataclass
from functools import partial
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.plugin import PluginError, class_named, is_class_name
from nav_bundle.base.pose import Pose
from nav_bundle.control.dwa_config import dwa_config_from_parameters
from nav_bundle.control.dwa_planner import DwaPlanner
from nav_bundle.control.local_planner import LocalPlanner
from nav_bundle.control.trajectory_config import trajectory_config_from_parameters
from nav_bundle.control.trajectory_planner import TrajectoryPlanner
from nav_bundle.costmap.config import CostmapConfig, costmap_config_from_parameters
from nav_bundle.costmap.costmap import NARROWEST_ROBOT
from nav_bundle.move_base.progress import ProgressLimits
from nav_bundle.move_base.recovery import Recovery, recoveries_from_parameters
from nav_bundle.move_base.state_machine import Limits
from nav_bundle.planning.global_planner import (
    GlobalPlanner,
    GlobalPlannerConfig,
    global_planner_config_from_parameters,
)
from nav_bundle.planning.navfn import MEETING_DISTANCE, NavfnConfig, NavfnPlanner
from nav_bundle.planning.planner import GlobalPlanner as Planner
from pioneer_node.core.live import Live, live_values
from pioneer_node.core.parameter import ONLY_LIVE, ParameterError, config_from_mapping, namespace_in

Kind = TypeVar("Kind")
_LONGEST_FULL_TURN = 35.0
"""Longest time [s] that a full turn may take for the robot to be allowed one without progress."""
_FRONT = 0.5
"""Cosine of 60 degrees: obstacles farther to the side do not count as in front."""

LocalKind = tuple[
    Callable[[Mapping[str, Any], str, float], Any], Callable[[Any, float], LocalPlanner]
]
_LOCAL_PLANNERS: dict[str, LocalKind] = {
    "base_local_planner/TrajectoryPlannerROS": (
        trajectory_config_from_parameters,
        TrajectoryPlanner,
    ),
    "dwa_local_planner/DWAPlannerROS": (dwa_config_from_parameters, DwaPlanner),
}
"""By type: reads the configuration from parameters, namespace and control frequency [Hz]; creates the planner from the
configuration and the local costmap's resolution [m]."""
GlobalKind = tuple[Callable[[Mapping[str, Any], str], Any], Callable[[Any], Planner]]
_GLOBAL_PLANNERS: dict[str, GlobalKind] = {
    "navfn/NavfnROS": (partial(config_from_mapping, NavfnConfig), NavfnPlanner),
    "global_planner/GlobalPlanner": (global_planner_config_from_parameters, GlobalPlanner),
}
"""By type: reads the configuration from parameters and namespace; creates the planner from the configuration."""


@dataclass(frozen=True)
class MoveBaseConfig:
    """The parameters in move_base's own namespace.

    ``shutdown_costmaps`` stops updating the costmaps while there is no goal. A plan of ``~make_plan`` starts on free
    ground with ``make_plan_clear_costmap``, and leads to a goal that the robot only gets near with
    ``make_plan_add_unreachable_goal``.

    ``base_global_planner`` may also be ``global_planner/GlobalPlanner``, and ``base_local_planner`` may be
    ``dwa_local_planner/DWAPlannerROS``. The package name is optional. Both may be ``package.module.Class`` of any
    Python package on the path; see ``nav_bundle.check_planner``.

    The following parameters are not in Noetic. ``odom_timeout`` [s] is the maximum age of odometry to drive on; 0
    disables the check. ``transform_future_limit`` [s] is how far ahead of the clock a transform or cancel may be
    stamped. An unmapped obstacle within ``meeting_distance`` [m] (0: disabled) and at least ``meeting_min_width`` [m]
    wide may be a robot. In front of it the speed is at most ``meeting_vel_scale`` [1/s] times the distance beyond
    ``meeting_margin`` [m], but never below ``meeting_min_vel`` [m/s], and the planner runs at
    ``meeting_planner_frequency`` [Hz]. A robot that is commanded to drive but stands for ``pushing_timeout`` [s] (0:
    disabled), or whose wheels slip, backs up and starts recovery.

    A robot makes progress if its remaining way by the global plan is ``progress_distance`` [m] less than the least so
    far. Without progress for ``progress_timeout`` [s] (0: disabled), or the time of a full turn in place at the slowest
    speed if that is longer, recovery starts. After each recovery behaviour there are ``planner_patience`` seconds more;
    after the last one the goal is aborted. Obstacles that are found on the way restart this at most
    ``max_progress_resets`` times a goal. A goal is also aborted after ``goal_timeout_scale`` (0: never) times the time
    that its first plan takes at full speed, but not before ``goal_timeout_min`` [s].
    """

    base_global_planner: Annotated[str, Live()] = "navfn/NavfnROS"
    base_local_planner: Annotated[str, Live()] = "base_local_planner/TrajectoryPlannerROS"
    controller_frequency: Annotated[float, Live(0.0, 100.0)] = 20.0
    planner_frequency: Annotated[float, Live(0.0, 100.0)] = 0.0
    planner_patience: Annotated[float, Live(0.0, 100.0)] = 5.0
    controller_patience: Annotated[float, Live(0.0, 100.0)] = 15.0
    max_planning_retries: Annotated[int, Live(-1, 1000)] = -1
    oscillation_timeout: Annotated[float, Live(0.0, 60.0)] = 0.0
    oscillation_distance: Annotated[float, Live(0.0, 10.0)] = 0.5
    recovery_behavior_enabled: Annotated[bool, Live()] = True
    clearing_rotation_allowed: Annotated[bool, Live()] = True
    conservative_reset_dist: Annotated[float, Live(0.0, 50.0)] = 3.0
    recovery_behaviors: Any = ()
    make_plan_clear_costmap: Annotated[bool, Live()] = True
    make_plan_add_unreachable_goal: Annotated[bool, Live()] = True
    shutdown_costmaps: Annotated[bool, Live()] = False
    restore_defaults: Annotated[bool, Live(), ONLY_LIVE] = False
    meeting_distance: Annotated[float, Live(0.0, 10.0)] = MEETING_DISTANCE
    meeting_min_width: Annotated[float, Live(0.0, 0.6)] = NARROWEST_ROBOT
    meeting_margin: Annotated[float, Live(0.0, 5.0)] = 0.5
    meeting_vel_scale: Annotated[float, Live(0.0, 5.0)] = 0.4
    meeting_min_vel: Annotated[float, Live(0.0, 5.0)] = 0.15
    meeting_planner_frequency: Annotated[float, Live(0.01, 100.0)] = 2.0
    pushing_timeout: Annotated[float, Live(0.0, 60.0)] = 3.0
    progress_timeout: Annotated[float, Live(0.0, 300.0)] = 22.0
    progress_distance: Annotated[float, Live(0.01, 10.0)] = 0.5
    max_progress_resets: Annotated[int, Live(0, 1000)] = 5
    goal_timeout_scale: Annotated[float, Live(0.0, 1000.0)] = 10.0
    goal_timeout_min: Annotated[float, Live(0.0, 3600.0)] = 120.0
    odom_timeout: float = 0.5
    transform_future_limit: float = 10.0


@dataclass(frozen=True)
class Care:
    """Limits the speed to ``scale`` [1/s] times the distance beyond ``margin`` [m].

    Two robots that meet thus have time to give way. The limit is never below ``slowest`` [m/s].
    """

    margin: float = 0.5
    scale: float = 0.4
    slowest: float = 0.15

    def speed(self, unmapped: NDArray[np.float64], pose: Pose) -> float:
        """Returns the speed limit [m/s] for the unmapped obstacles (n, 2) [m] in front; infinity if there are none."""
        ahead = unmapped - (pose.x, pose.y)
        along = ahead @ (math.cos(pose.yaw), math.sin(pose.yaw))
        distance = np.hypot(ahead[:, 0], ahead[:, 1])
        in_front = distance[along > _FRONT * distance]
        if not len(in_front):
            return math.inf
        return max(self.slowest, self.scale * (float(in_front.min()) - self.margin))


@dataclass(frozen=True)
class Setup:
    """Complete configuration of move_base.

    Planner names are also the namespaces of the planners' parameters and topics; ``global_planner`` and
    ``local_planner`` are their configurations.
    """

    base: MoveBaseConfig
    global_costmap: CostmapConfig
    local_costmap: CostmapConfig
    global_planner_name: str
    global_planner: Any
    local_planner_name: str
    local_planner: Any
    recoveries: tuple[Recovery, ...]
    limits: Limits = field(default_factory=Limits)

    def live_configs(self) -> dict[str, Any]:
        """Returns the dynamically reconfigurable configurations, by namespace relative to the node."""
        configs: dict[str, Any] = {"": self.base}
        # A planner of another package may have a plain dict.
        if is_dataclass(self.local_planner) and live_values(self.local_planner):
            configs[self.local_planner_name] = self.local_planner
        if is_dataclass(self.global_planner) and live_values(self.global_planner):
            configs[self.global_planner_name] = self.global_planner
        for name, costmap in (
            ("global_costmap", self.global_costmap),
            ("local_costmap", self.local_costmap),
        ):
            configs[name] = costmap
            layers = zip(costmap.layer_names, costmap.layers, strict=True)
            configs.update({f"{name}/{layer_name}": layer for layer_name, layer in layers})
        return configs

    @property
    def publishes_cell_costs(self) -> bool:
        """Whether the local planner's costs of cells are published."""
        return bool(getattr(self.local_planner, "publish_cost_grid_pc", False))

    @property
    def goal_tolerance(self) -> float:
        """Distance from a goal [m] within which the global planner's paths may end."""
        return float(getattr(self.global_planner, "default_tolerance", 0.0))

    @property
    def potential_scale(self) -> int:
        """Maximum value of the published potential; 0 if it is not published."""
        planner = self.global_planner
        return (
            planner.publish_scale
            if isinstance(planner, GlobalPlannerConfig) and planner.publish_potential
            else 0
        )

    @property
    def care(self) -> Care:
        """Speed limit in front of unmapped obstacles."""
        return Care(
            self.base.meeting_margin, self.base.meeting_vel_scale, self.base.meeting_min_vel
        )

    def make_global_planner(self) -> Planner:
        """Returns a new global planner of the configured type."""
        _, (_, make) = _global_planner(self.base.base_global_planner, "global planner")
        return make(self.global_planner)

    def drives_as(self, other: "Setup") -> bool:
        """Returns whether both setups have the same local planner, configuration and local costmap resolution."""
        mine, its = (
            (each.local_planner_name, each.local_planner, each.local_costmap.resolution)
            for each in (self, other)
        )
        return mine == its

    def make_local_planner(self) -> LocalPlanner:
        """Returns a new local planner of the configured type, for the local costmap's resolution."""
        _, (_, make) = _local_planner(self.base.base_local_planner, "local planner")
        return make(self.local_planner, self.local_costmap.resolution)


def changed_parameters(
    parameters: Mapping[str, Any], setup: Setup, namespace: str, changes: Mapping[str, Any]
) -> dict[str, Any]:
    """Returns ``parameters``, from which ``setup`` was built, with ``changes`` to one of its ``live_configs``.

    As in dynamic_reconfigure, all live values of that namespace are written out. A default derived from another
    parameter thus keeps its value.
    """
    tree = dict(parameters)
    own = tree
    for name in filter(None, namespace.split("/")):
        found = own.get(name)
        own[name] = dict(found) if isinstance(found, Mapping) else {}
        own = own[name]
    for name, value in {**live_values(setup.live_configs()[namespace]), **changes}.items():
        own.pop(name, None)  # moves it behind a deprecated name of the same parameter
        own[name] = value
    return tree


def setup_from_parameters(parameters: Mapping[str, Any], owner: str) -> Setup:
    """Returns the setup of the node ``owner`` from all of its private parameters.

    ``footprint`` and ``robot_radius`` may also be in the node's own namespace, for both costmaps.

    Raises:
        ParameterError: an unknown or invalid parameter, or an unknown planner.
    """
    nested = {name for name, value in parameters.items() if isinstance(value, Mapping)}
    base = config_from_mapping(
        MoveBaseConfig, parameters, owner, nested | {"footprint", "robot_radius"}
    )
    _check(base, owner)
    global_costmap, local_costmap = (
        costmap_config_from_parameters(
            namespace_in(parameters, name, owner), f"{owner}/{name}", parameters
        )
        for name in ("global_costmap", "local_costmap")
    )
    radius = local_costmap.outline().circumscribed_radius
    recoveries = (
        tuple(recoveries_from_parameters(parameters, radius))
        if base.recovery_behavior_enabled
        else ()
    )
    name, (read_local, _) = _local_planner(base.base_local_planner, f"{owner}: ~base_local_planner")
    global_name, (read_global, _) = _global_planner(
        base.base_global_planner, f"{owner}: ~base_global_planner"
    )
    local_planner = read_local(
        namespace_in(parameters, name, owner), f"{owner}/{name}", base.controller_frequency
    )
    return Setup(
        base,
        global_costmap,
        local_costmap,
        global_name,
        read_global(namespace_in(parameters, global_name, owner), f"{owner}/{global_name}"),
        name,
        local_planner,
        recoveries,
        _limits(base, len(recoveries), local_planner),
    )


def _check(base: MoveBaseConfig, owner: str) -> None:
    for name in ("controller_frequency", "meeting_planner_frequency"):
        if getattr(base, name) <= 0.0:
            raise ParameterError(f"{owner}: ~{name} must be positive, not {getattr(base, name)}")


def _planner(
    kinds: dict[str, Kind], wanted: str, what: str, of_class: Callable[[type[Any]], Kind]
) -> tuple[str, Kind]:
    """Returns the planner's name without its package, and its entry in ``kinds``, or that of its class.

    Args:
        kinds: the planners of this package, by type.
        wanted: a type, or ``package.module.Class``.
        what: names the parameter in messages.
        of_class: returns the entry of a class of another package.
    """
    for full, kind in kinds.items():
        name = full.split("/")[-1]
        if wanted in (full, name):
            return name, kind
    if is_class_name(wanted):
        try:
            found = class_named(wanted)
        except PluginError as error:
            raise ParameterError(f"{what}: {error}") from error
        return found.__name__, of_class(found)
    raise ParameterError(
        f"{what} {wanted!r} is not available; there are {', '.join(kinds)}, and any package.module.Class"
    )


def _config_of(kind: type[Any], parameters: Mapping[str, Any], owner: str) -> Any:
    """Returns the configuration of a planner of another package: its ``Config``, or the parameters themselves."""
    config_class = getattr(kind, "Config", None)
    if config_class is None:
        return dict(parameters)
    return config_from_mapping(config_class, parameters, owner)


def _global_kind(kind: type[Any]) -> GlobalKind:
    return partial(_config_of, kind), kind


def _local_kind(kind: type[Any]) -> LocalKind:
    def read(parameters: Mapping[str, Any], owner: str, _: float) -> Any:
        return _config_of(kind, parameters, owner)

    return read, kind


def _global_planner(wanted: str, what: str) -> tuple[str, GlobalKind]:
    return _planner(_GLOBAL_PLANNERS, wanted, what, _global_kind)


def _local_planner(wanted: str, what: str) -> tuple[str, LocalKind]:
    return _planner(_LOCAL_PLANNERS, wanted, what, _local_kind)


def _progress_timeout(base: MoveBaseConfig, local_planner: Any) -> float:
    """Returns the time without progress [s] that suits the robot: a slow one has to be able to turn round."""
    if base.progress_timeout <= 0.0:
        return 0.0
    slowest = float(
        getattr(
            local_planner, "min_in_place_vel_theta", getattr(local_planner, "min_vel_theta", 0.0)
        )
    )
    full_turn = math.tau / slowest if slowest > 0.0 else 0.0
    return max(base.progress_timeout, min(full_turn, _LONGEST_FULL_TURN))


def _limits(base: MoveBaseConfig, recoveries: int, local_planner: Any) -> Limits:
    progress = ProgressLimits(
        distance=base.progress_distance,
        timeout=_progress_timeout(base, local_planner),
        patience=base.planner_patience,
        recoveries=recoveries,
        resets=base.max_progress_resets,
        scale=base.goal_timeout_scale,
        least_total=base.goal_timeout_min,
        speed=getattr(local_planner, "max_vel_x", 1.0),
    )
    return Limits(
        planner_frequency=base.planner_frequency,
        planner_patience=base.planner_patience,
        controller_patience=base.controller_patience,
        max_planning_retries=base.max_planning_retries,
        oscillation_timeout=base.oscillation_timeout,
        oscillation_distance=base.oscillation_distance,
        meeting_period=1.0 / base.meeting_planner_frequency,
        recoveries=recoveries,
        progress=progress,
    )
