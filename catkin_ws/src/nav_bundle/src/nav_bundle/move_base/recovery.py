"""Recovery behaviours that move_base runs when planning or control fails."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Protocol

from nav_bundle.base.plugin import PluginError, class_named, is_class_name
from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.base.velocity import Velocity
from nav_bundle.costmap.costmap import Costmap
from pioneer_node.core.parameter import (
    UNKNOWN,
    ParameterError,
    WithoutEffect,
    config_from_mapping,
    namespace_in,
    value_as,
)

_BACK, _LOOK_BACK, _BACKWARDS = 0.3, 0.1, -0.15
"""Distance that a pushing robot backs up [m], look-behind distance for obstacles [m], and velocity [m/s]."""
_SLOWEST_ROTATION = 0.1
"""Rotational speed [rad/s] that bounds a rotation if the parameters allow slower ones."""
_ALLOWANCE = 3.0
"""A movement may take this many times as long as at its commanded speed; a robot whose motors are off never ends it."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Input of a recovery behaviour: both costmaps, the robot's pose in the frame of each, and the ROS time [s]."""

    global_costmap: Costmap
    global_pose: Pose
    local_costmap: Costmap
    local_pose: Pose
    now: float


class Movement:
    """Bounds a movement in time.

    Args:
        duration: how long it takes at its commanded speed [s].
    """

    def __init__(self, duration: float) -> None:
        self.limit = _ALLOWANCE * duration  #: maximum duration [s]
        self._begun: float | None = None

    def start(self) -> None:
        """Restarts the movement; it begins at the next check."""
        self._begun = None

    def is_overdue(self, now: float) -> bool:
        """Returns whether the movement has taken too long at ROS time ``now`` [s]."""
        if self._begun is None:
            self._begun = now
        return now - self._begun > self.limit


@dataclass(frozen=True)
class SpeedLimit:
    """Speeds [m/s] and [rad/s] that a recovery behaviour allows for the next ``distance`` [m]."""

    speed: float
    turn: float
    distance: float


class Recovery(Protocol):
    """One recovery behaviour, executed in steps. It ends in bounded time, whatever the robot does.

    ``name`` is its parameter namespace; ``complaint`` is the reason if it ended early, else empty. ``limit`` holds for
    the robot once the behaviour has ended.
    """

    name: str
    complaint: str
    limit: SpeedLimit | None

    def start(self) -> None:
        """Starts the behaviour from the beginning."""
        ...

    def step(self, around: Surroundings) -> Velocity | None:
        """Runs one step; returns the velocity to command, None once the behaviour has ended."""
        ...


_EVERY_PLANNER = WithoutEffect("is not used: the limit holds for every local planner")


@dataclass(frozen=True)
class ClearConfig:
    """Parameters of clear_costmap_recovery: side of the square that is kept [m], and which costmaps to clear.

    With ``invert_area_to_clear`` the square is cleared, and what is outside it is kept. ``layer_names`` are the
    obstacle layers to clear; empty for all.
    """

    reset_distance: float = 3.0
    invert_area_to_clear: bool = False
    force_updating: Annotated[
        bool, WithoutEffect("is always so: costmaps are updated after a recovery behaviour")
    ] = False
    affected_maps: str = "both"
    layer_names: Any = ()


class ClearCostmapRecovery:
    """Clears sensor obstacles outside the square of side ``reset_distance`` around the robot, or inside it."""

    limit: SpeedLimit | None = None

    def __init__(self, name: str, config: ClearConfig) -> None:
        self.name, self.complaint = name, ""
        self._config = config
        if config.affected_maps not in ("local", "global", "both"):
            raise ParameterError(
                f"~{name}/affected_maps must be local, global or both, not {config.affected_maps!r}"
            )

    def start(self) -> None:
        """Does nothing."""

    def step(self, around: Surroundings) -> Velocity | None:
        """Clears the costmaps; always returns None, since one step is enough."""
        if self._config.affected_maps in ("global", "both"):
            self._clear(around.global_costmap, around.global_pose)
        if self._config.affected_maps in ("local", "both"):
            self._clear(around.local_costmap, around.local_pose)
        return None

    def _clear(self, costmap: Costmap, pose: Pose) -> None:
        config = self._config
        clear = costmap.clear_inside if config.invert_area_to_clear else costmap.clear_outside
        clear(pose, config.reset_distance, _names(config.layer_names))


@dataclass(frozen=True)
class SlowConfig:
    """Parameters of move_slow_and_clear.

    Sensor obstacles nearer than ``clearing_distance`` [m] are cleared; then the robot drives at most at
    ``limited_trans_speed`` [m/s] and ``limited_rot_speed`` [rad/s] until it is ``limited_distance`` [m] away.
    """

    clearing_distance: float = 0.5
    limited_trans_speed: float = 0.25
    limited_rot_speed: float = 0.45
    limited_distance: float = 0.3
    max_trans_param_name: Annotated[str, _EVERY_PLANNER] = "max_trans_vel"
    max_rot_param_name: Annotated[str, _EVERY_PLANNER] = "max_rot_vel"
    planner_namespace: Annotated[str, _EVERY_PLANNER] = "DWAPlannerROS"
    layer_names: Any = ()


class MoveSlowAndClear:
    """Clears sensor obstacles around the robot, which then leaves the place slowly."""

    def __init__(self, name: str, config: SlowConfig) -> None:
        self.name, self.complaint = name, ""
        self._config = config
        self.limit: SpeedLimit | None = SpeedLimit(
            config.limited_trans_speed, config.limited_rot_speed, config.limited_distance
        )

    def start(self) -> None:
        """Does nothing."""

    def step(self, around: Surroundings) -> Velocity | None:
        """Clears both costmaps around the robot; always returns None, since one step is enough."""
        side = 2.0 * self._config.clearing_distance
        names = _names(self._config.layer_names)
        around.global_costmap.clear_inside(around.global_pose, side, names)
        around.local_costmap.clear_inside(around.local_pose, side, names)
        return None


@dataclass(frozen=True)
class RotateConfig:
    """Parameters of rotate_recovery: angle between collision checks [rad], speeds [rad/s], acceleration [rad/s**2]."""

    sim_granularity: float = 0.017
    frequency: Annotated[
        float, WithoutEffect("is not used: move_base's ~controller_frequency counts")
    ] = 20.0
    yaw_goal_tolerance: float = 0.10
    acc_lim_th: float = 3.2
    max_rotational_vel: float = 1.0
    min_in_place_rotational_vel: float = 0.4


class RotateRecovery:
    """Rotates the robot once to the left while the footprint stays free, so that sensors see all directions.

    As in Noetic, a ``yaw_goal_tolerance`` of more than half a turn (3.15 means any heading) ends the rotation at once.
    A laser with a full field of view gains nothing from it.
    """

    limit: SpeedLimit | None = None

    def __init__(self, name: str, config: RotateConfig) -> None:
        self.name, self.complaint = name, ""
        self._config = config
        self._begun: float | None = None
        self._half_way = False
        # A rotation may be slow all the way, and as slow as the local planner turns.
        slowest = min(config.min_in_place_rotational_vel, config.max_rotational_vel)
        self._movement = Movement(math.tau / max(slowest, _SLOWEST_ROTATION))

    def start(self) -> None:
        """Restarts the rotation; the next step sets its start heading."""
        self.complaint = ""
        self._begun = None
        self._half_way = False
        self._movement.start()

    def step(self, around: Surroundings) -> Velocity | None:
        """Returns the turning velocity; None after the full rotation or if an obstacle blocks it."""
        yaw = around.local_pose.yaw
        if self._begun is None:
            self._begun = yaw
        left = self._left(yaw)
        if self._half_way and left < self._config.yaw_goal_tolerance:
            return None
        if self._movement.is_overdue(around.now):
            self.complaint = f"Rotate recovery ended: the robot has not turned round in {self._movement.limit:.0f} s."
            return None
        if not self._is_free(around, left):
            self.complaint = (
                "Rotate recovery can't rotate in place because there is a potential collision."
            )
            return None
        speed = math.sqrt(2.0 * self._config.acc_lim_th * left)
        return Velocity(
            turn=min(
                max(speed, self._config.min_in_place_rotational_vel),
                self._config.max_rotational_vel,
            )
        )

    def _left(self, yaw: float) -> float:
        """Returns the remaining angle [rad]."""
        assert self._begun is not None
        if not self._half_way:
            to_half = angle_difference(self._begun + math.pi, yaw)
            if abs(to_half) >= self._config.yaw_goal_tolerance:
                return math.pi + (to_half if to_half >= 0.0 else to_half + math.tau)
            self._half_way = True
        return abs(angle_difference(self._begun, yaw))

    def _is_free(self, around: Surroundings, left: float) -> bool:
        pose = around.local_pose
        for i in range(math.ceil(left / self._config.sim_granularity)):
            turned = Pose(pose.x, pose.y, pose.yaw + i * self._config.sim_granularity)
            if around.local_costmap.footprint_cost(turned) < 0:
                return False
        return True


class BackUp:
    """Backs up from the obstacle that the robot pushes against, then runs ``following``."""

    def __init__(self, following: Recovery) -> None:
        self._following = following
        self.name, self.complaint = following.name, ""
        self.limit = following.limit
        self._from: Pose | None = None
        self._away = False
        self._movement = Movement(_BACK / -_BACKWARDS)
        self._failure = ""

    def start(self) -> None:
        """Restarts the behaviour; the next step sets its start pose."""
        self._from = None
        self._away = False
        self._failure = ""
        self._movement.start()
        self._following.start()

    def step(self, around: Surroundings) -> Velocity | None:
        """Returns a backward velocity while backing up is free, then the velocity of ``following``."""
        pose = around.local_pose
        self._from = self._from or pose
        behind = Pose(*pose.apply(-_LOOK_BACK, 0.0), pose.yaw)
        self._away = (
            self._away
            or pose.distance(self._from) > _BACK
            or around.local_costmap.footprint_cost(behind) < 0
        )
        if not self._away and self._movement.is_overdue(around.now):
            self._away = True
            self._failure = f"The robot has not backed up in {self._movement.limit:.0f} s."
        if not self._away:
            return Velocity(_BACKWARDS)
        velocity = self._following.step(around)
        self.complaint = " ".join(
            text for text in (self._failure, self._following.complaint) if text
        )
        return velocity


def _names(value: Any) -> tuple[str, ...]:
    """Returns the names in ``layer_names``: a list, or a single name."""
    return (value,) if isinstance(value, str) else tuple(str(name) for name in value)


def recoveries_from_parameters(
    parameters: Mapping[str, Any], circumscribed_radius: float
) -> list[Recovery]:
    """Returns move_base's behaviours in order: those of ``recovery_behaviors``, else Noetic's four defaults.

    Raises:
        ParameterError: an entry that is not {name, type}, an unknown type, or invalid parameters.
    """
    listed = parameters.get("recovery_behaviors")
    if listed and not isinstance(listed, (list, tuple)):
        raise ParameterError(
            f"~recovery_behaviors must be a list of {{name, type}}, not {listed!r}"
        )
    if listed:
        return [_recovery(parameters, entry, 3.0) for entry in listed]
    clear, rotate = "clear_costmap_recovery/ClearCostmapRecovery", "rotate_recovery/RotateRecovery"
    conservative = value_as(
        float, parameters.get("conservative_reset_dist", 3.0), "~conservative_reset_dist"
    )
    behaviours = [
        _recovery(parameters, {"name": "conservative_reset", "type": clear}, conservative)
    ]
    turn = [_recovery(parameters, {"name": "rotate_recovery", "type": rotate}, 0.0)]
    turns = turn if parameters.get("clearing_rotation_allowed", True) else []
    aggressive = _recovery(
        parameters, {"name": "aggressive_reset", "type": clear}, 4.0 * circumscribed_radius
    )
    return [*behaviours, *turns, aggressive, *turns]


def _report_extra(entry: Mapping[str, Any], name: str) -> None:
    """Warns of parameters in an entry of the list: a behaviour reads those in its own namespace."""
    for extra in sorted(str(key) for key in entry.keys() - {"name", "type"}):
        UNKNOWN.complain(
            f"~recovery_behaviors: {extra} of {name} is not read in the list; give it as ~{name}/{extra}"
        )


def _recovery(parameters: Mapping[str, Any], entry: Any, reset_distance: float) -> Recovery:
    try:
        name, full = str(entry["name"]), str(entry["type"])
    except (KeyError, TypeError):
        raise ParameterError(
            f"~recovery_behaviors needs entries of {{name, type}}, not {entry!r}"
        ) from None
    _report_extra(entry, name)
    kind = full.split("/")[-1]
    if is_class_name(full):
        try:
            return class_named(full)(
                name, dict(namespace_in(parameters, name, "~recovery_behaviors"))
            )
        except PluginError as error:
            raise ParameterError(f"~recovery_behaviors: {error}") from error
    if kind not in _MAKERS:
        raise ParameterError(
            f"~recovery_behaviors: no such type {entry['type']!r}; there are {', '.join(_MAKERS)}"
        )
    return _MAKERS[kind](parameters, name, reset_distance)


def _clear(parameters: Mapping[str, Any], name: str, reset_distance: float) -> Recovery:
    own = {
        "reset_distance": reset_distance,
        **namespace_in(parameters, name, "~recovery_behaviors"),
    }
    return ClearCostmapRecovery(name, config_from_mapping(ClearConfig, own, f"~{name}"))


def _rotate(parameters: Mapping[str, Any], name: str, _: float) -> Recovery:
    """Returns the behaviour; its speeds default to the local planner's parameters."""
    planner = namespace_in(parameters, "TrajectoryPlannerROS", "~recovery_behaviors")
    names = {
        "yaw_goal_tolerance": "yaw_goal_tolerance",
        "acc_lim_theta": "acc_lim_th",
        "acc_lim_th": "acc_lim_th",
        "max_vel_theta": "max_rotational_vel",
        "max_rotational_vel": "max_rotational_vel",
        "min_in_place_vel_theta": "min_in_place_rotational_vel",
        "min_in_place_rotational_vel": "min_in_place_rotational_vel",
    }
    shared = {ours: planner[theirs] for theirs, ours in names.items() if theirs in planner}
    own = {**shared, **namespace_in(parameters, name, "~recovery_behaviors")}
    return RotateRecovery(name, config_from_mapping(RotateConfig, own, f"~{name}"))


def _slow(parameters: Mapping[str, Any], name: str, _: float) -> Recovery:
    own = namespace_in(parameters, name, "~recovery_behaviors")
    config = config_from_mapping(SlowConfig, own, f"~{name}")
    for each in ("limited_trans_speed", "limited_rot_speed"):
        if getattr(config, each) <= 0.0:
            raise ParameterError(f"~{name}/{each} must be positive, not {getattr(config, each)}")
    return MoveSlowAndClear(name, config)


Maker = Callable[[Mapping[str, Any], str, float], Recovery]
_MAKERS: dict[str, Maker] = {
    "ClearCostmapRecovery": _clear,
    "RotateRecovery": _rotate,
    "MoveSlowAndClear": _slow,
}
"""By type: creates the behaviour from move_base's parameters, its name and the default reset distance [m]."""
