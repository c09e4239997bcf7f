"""Parameters of move_base under their Noetic names."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from nav_bundle.core.costmap.config import CostmapConfig, costmap_config_from_parameters
from nav_bundle.core.dwa_config import DwaConfig, dwa_config_from_parameters
from nav_bundle.core.dwa_planner import DwaPlanner
from nav_bundle.core.local_planner import LocalPlanner
from nav_bundle.core.move_base import Limits
from nav_bundle.core.navfn import NavfnConfig
from nav_bundle.core.recovery import Recovery, recoveries_from_parameters
from nav_bundle.core.trajectory_config import TrajectoryConfig, trajectory_config_from_parameters
from nav_bundle.core.trajectory_planner import TrajectoryPlanner
from pioneer_node.core.parameter import ParameterError, config_from_mapping

LocalReader = Callable[[Mapping[str, Any], str, float], TrajectoryConfig | DwaConfig]
"""Makes a local planner's configuration of its parameters, its namespace and the control frequency [Hz]."""

_LOCAL_PLANNERS: dict[str, LocalReader] = {
    "base_local_planner/TrajectoryPlannerROS": trajectory_config_from_parameters,
    "dwa_local_planner/DWAPlannerROS": dwa_config_from_parameters,
}
_GLOBAL_PLANNER = "NavfnROS"


@dataclass(frozen=True)
class MoveBaseConfig:
    """The parameters in move_base's own namespace.

    ``odom_timeout`` [s] is ours: the longest silence of the odometry that the robot may still drive on, 0 for
    any. ``base_global_planner`` names the only one there is; ``base_local_planner`` may also be
    ``dwa_local_planner/DWAPlannerROS``. The packages' names may be left out.
    """

    base_global_planner: str = "navfn/NavfnROS"
    base_local_planner: str = "base_local_planner/TrajectoryPlannerROS"
    controller_frequency: float = 20.0
    planner_frequency: float = 0.0
    planner_patience: float = 5.0
    controller_patience: float = 15.0
    max_planning_retries: int = -1
    oscillation_timeout: float = 0.0
    oscillation_distance: float = 0.5
    recovery_behavior_enabled: bool = True
    clearing_rotation_allowed: bool = True
    conservative_reset_dist: float = 3.0
    recovery_behaviors: Any = ()
    make_plan_clear_costmap: bool = True
    make_plan_add_unreachable_goal: bool = True
    shutdown_costmaps: bool = False
    restore_defaults: bool = False
    odom_timeout: float = 0.5


@dataclass(frozen=True)
class Setup:
    """Everything move_base is made from; ``local_planner_name`` is the namespace of its parameters and topics."""

    base: MoveBaseConfig
    global_costmap: CostmapConfig
    local_costmap: CostmapConfig
    navfn: NavfnConfig
    local_planner_name: str
    local_planner: TrajectoryConfig | DwaConfig
    recoveries: tuple[Recovery, ...]
    limits: Limits = field(default_factory=Limits)

    def make_local_planner(self) -> LocalPlanner:
        """Returns the local planner that was asked for, on the local costmap's cells."""
        resolution = self.local_costmap.resolution
        if isinstance(self.local_planner, DwaConfig):
            return DwaPlanner(self.local_planner, resolution)
        return TrajectoryPlanner(self.local_planner, resolution)


def setup_from_parameters(parameters: Mapping[str, Any], owner: str) -> Setup:
    """Returns the set-up of the node ``owner`` from all of its private parameters.

    Raises:
        ParameterError: an unknown or wrong parameter, or a planner that does not exist.
    """
    nested = {name for name, value in parameters.items() if isinstance(value, Mapping)}
    base = config_from_mapping(MoveBaseConfig, parameters, owner, nested)
    _check(base, owner)
    local_costmap = costmap_config_from_parameters(parameters.get("local_costmap", {}), f"{owner}/local_costmap")
    radius = local_costmap.outline().circumscribed_radius
    recoveries = tuple(recoveries_from_parameters(parameters, radius)) if base.recovery_behavior_enabled else ()
    name, local_planner_from_parameters = _local_planner(base, owner)
    return Setup(
        base,
        costmap_config_from_parameters(parameters.get("global_costmap", {}), f"{owner}/global_costmap"),
        local_costmap,
        config_from_mapping(NavfnConfig, parameters.get(_GLOBAL_PLANNER, {}), f"{owner}/{_GLOBAL_PLANNER}"),
        name,
        local_planner_from_parameters(parameters.get(name, {}), f"{owner}/{name}", base.controller_frequency),
        recoveries,
        _limits(base, len(recoveries)),
    )


def _check(base: MoveBaseConfig, owner: str) -> None:
    if base.base_global_planner.split("/")[-1] != _GLOBAL_PLANNER:
        raise ParameterError(
            f"{owner}: ~base_global_planner {base.base_global_planner!r} is not available, only navfn/NavfnROS"
        )
    if base.controller_frequency <= 0.0:
        raise ParameterError(f"{owner}: ~controller_frequency must be positive, not {base.controller_frequency}")


def _local_planner(base: MoveBaseConfig, owner: str) -> tuple[str, LocalReader]:
    """Returns the local planner's name without its package, and what reads its parameters."""
    wanted = base.base_local_planner
    for full, reader in _LOCAL_PLANNERS.items():
        name = full.split("/")[-1]
        if wanted in (full, name):
            return name, reader
    known = ", ".join(_LOCAL_PLANNERS)
    raise ParameterError(f"{owner}: ~base_local_planner {wanted!r} is not available; there are {known}")


def _limits(base: MoveBaseConfig, recoveries: int) -> Limits:
    return Limits(
        planner_frequency=base.planner_frequency,
        planner_patience=base.planner_patience,
        controller_patience=base.controller_patience,
        max_planning_retries=base.max_planning_retries,
        oscillation_timeout=base.oscillation_timeout,
        oscillation_distance=base.oscillation_distance,
        recoveries=recoveries,
    )
