"""The global planner GlobalPlanner: navfn's wavefront with other weights, expanded as Dijkstra or A*."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.costmap.cost import UNKNOWN
from nav_bundle.planning.navfn import NO_CLOUD, WHOLE_MAP, NavfnConfig, NavfnPlanner
from nav_bundle.planning.navfn_kernel import FAR
from nav_bundle.planning.planner import Path
from pioneer_node.core.live import Live
from pioneer_node.core.parameter import (
    ONLY_LIVE,
    ParameterError,
    WithoutEffect,
    config_from_mapping,
)

_BLOCKED = -1
_BEND = 0.35
"""A path that bends by more than this [rad] between two poses is not straight, as in global_planner."""


class Orientation(IntEnum):
    """Values of ``orientation_mode``."""

    NONE = 0
    FORWARD = 1
    INTERPOLATE = 2
    FORWARD_THEN_INTERPOLATE = 3
    BACKWARD = 4
    LEFTWARD = 5
    RIGHTWARD = 6


_TURNED = {
    Orientation.FORWARD: 0.0,
    Orientation.FORWARD_THEN_INTERPOLATE: 0.0,
    Orientation.BACKWARD: math.pi,
    Orientation.LEFTWARD: -math.pi / 2,
    Orientation.RIGHTWARD: math.pi / 2,
}


def oriented(path: Path, start: Pose, mode: Orientation, window: int) -> Path:
    """Returns ``path`` (n, 3) with headings set by ``mode``; the last pose keeps the goal's heading.

    Args:
        path: from the robot to the goal.
        start: the robot's pose.
        mode: along, against or across the path; or interpolated from the robot's heading to the goal's; or along the
            path up to its last straight part, and interpolated from there.
        window: number of poses on either side that determine the direction of the path.
    """
    turned = path.copy()
    if mode in _TURNED and len(path) > 1:
        before = np.maximum(np.arange(len(path) - 1) - window, 0)
        after = np.minimum(np.arange(len(path) - 1) + window, len(path) - 1)
        step = path[after, :2] - path[before, :2]
        along = np.arctan2(step[:, 1], step[:, 0]) + _TURNED[mode]
        turned[:-1, 2] = np.arctan2(np.sin(along), np.cos(along))
    if mode is Orientation.INTERPOLATE:
        _interpolate(turned, start, 0)
    if mode is Orientation.FORWARD_THEN_INTERPOLATE:
        _interpolate(turned, start, _last_straight(turned))
    return turned


def _last_straight(path: Path) -> int:
    """Returns the index where the last straight part of a path begins."""
    index = max(len(path) - 3, 0)
    last = float(path[index, 2])
    while index > 0 and abs(angle_difference(float(path[index - 1, 2]), last)) <= _BEND:
        index -= 1
    return index


def _interpolate(path: Path, start: Pose, first: int) -> None:
    """Interpolates headings from the one at ``first`` (the robot's, if 0) to the goal's."""
    begin = start.yaw if first == 0 else float(path[first, 2])
    turn = angle_difference(float(path[-1, 2]), begin)
    path[first:, 2] = begin + turn * np.linspace(0.0, 1.0, len(path) - first)


@dataclass(frozen=True)
class GlobalPlannerConfig:
    """Parameters under ``~GlobalPlanner``; defaults are Noetic's.

    A cell of cost c weighs ``neutral_cost + cost_factor c``, at most ``lethal_cost - 1``; cells with cost
    ``lethal_cost`` or more are blocked. With ``use_dijkstra`` false the wavefront expands towards the goal first (A*),
    which is faster on open ground. ``use_grid_path`` follows the path from cell to cell instead of down the gradient.
    ``orientation_mode`` is one of ``Orientation``; ``orientation_window_size`` [poses] is the look-ahead
    for the path's direction. ``publish_potential`` publishes the potential scaled to 0 … ``publish_scale``.
    Not in Noetic: ``keep_right``, see ``navfn.NavfnConfig``.
    """

    allow_unknown: bool = True
    default_tolerance: float = 0.0
    use_dijkstra: bool = True
    use_quadratic: bool = True
    use_grid_path: bool = False
    old_navfn_behavior: bool = False
    lethal_cost: Annotated[int, Live(1, 253)] = 253
    neutral_cost: Annotated[int, Live(1, 252)] = 50
    cost_factor: Annotated[float, Live(0.01, 5.0)] = 3.0
    orientation_mode: Annotated[int, Live(0, 6)] = 0
    orientation_window_size: Annotated[int, Live(1, 255)] = 1
    outline_map: Annotated[
        bool, WithoutEffect("is not used: no path leaves the map, whatever its border holds")
    ] = True
    publish_potential: Annotated[bool, Live()] = True
    publish_scale: int = 100
    visualize_potential: Annotated[bool, NO_CLOUD] = False
    planner_window_x: Annotated[float, WHOLE_MAP] = 0.0
    planner_window_y: Annotated[float, WHOLE_MAP] = 0.0
    keep_right: bool = True
    restore_defaults: Annotated[bool, Live(), ONLY_LIVE] = False

    def weights(self) -> NDArray[np.float32]:
        """Returns the potential added by crossing a cell, by its cost; negative if blocked. Shape (256,)."""
        dearest = self.lethal_cost - 1
        table = np.floor(
            np.minimum(self.neutral_cost + self.cost_factor * np.arange(256), dearest)
        ).astype(np.float32)
        table[self.lethal_cost :] = _BLOCKED
        table[UNKNOWN] = dearest if self.allow_unknown else _BLOCKED
        return table


def global_planner_config_from_parameters(
    parameters: Mapping[str, Any], owner: str
) -> GlobalPlannerConfig:
    """Returns the configuration in namespace ``owner``.

    Raises:
        ParameterError: an unknown name, a wrong type, a value out of range, or an unsupported option.
    """
    config = config_from_mapping(GlobalPlannerConfig, parameters, owner)
    offered = {"use_quadratic": True, "old_navfn_behavior": False}
    for name, value in offered.items():
        if getattr(config, name) != value:
            raise ParameterError(
                f"{owner}: ~{name} {getattr(config, name)!r} is not available, only {value!r}"
            )
    bounds = (
        ("lethal_cost", 2, 253),
        ("neutral_cost", 1, 252),
        ("cost_factor", 0.01, 5.0),
        ("orientation_mode", 0, 6),
        ("orientation_window_size", 1, 255),
        ("publish_scale", 1, 100),
    )
    for name, low, high in bounds:
        if not low <= getattr(config, name) <= high:
            raise ParameterError(
                f"{owner}: ~{name} must lie in {low} to {high}, not {getattr(config, name)}"
            )
    return config


def visible_potential(potential: NDArray[np.float32], scale: int) -> NDArray[np.int8]:
    """Returns the potential scaled to 0 … ``scale``, -1 in cells not reached, as global_planner publishes it."""
    reached = potential < FAR
    values = np.full(potential.shape, -1, np.int8)
    highest = float(potential[reached].max(initial=0.0)) or 1.0
    values[reached] = (potential[reached] * (scale / highest)).astype(np.int8)
    return values


class GlobalPlanner(NavfnPlanner):
    """Plans as global_planner does: quadratic potential, gradient or grid path, then headings along the path."""

    def __init__(self, config: GlobalPlannerConfig) -> None:
        super().__init__(
            NavfnConfig(
                config.allow_unknown, config.default_tolerance, keep_right=config.keep_right
            )
        )
        self._weights = config.weights()
        self._follow_cells = config.use_grid_path
        self._orientation, self._window = (
            Orientation(config.orientation_mode),
            config.orientation_window_size,
        )
        self._guided = not config.use_dijkstra

    def _finished(self, start: Pose, path: Path) -> Path:
        return oriented(path, start, self._orientation, self._window)
