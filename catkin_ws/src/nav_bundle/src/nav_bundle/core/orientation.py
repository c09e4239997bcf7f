"""Headings along a path: global_planner's orientation filter."""

import math
from enum import IntEnum

import numpy as np

from nav_bundle.core.planner import Path
from nav_bundle.core.pose import Pose, angle_difference

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
