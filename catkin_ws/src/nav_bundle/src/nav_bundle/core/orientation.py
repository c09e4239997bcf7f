"""Headings along a path: what global_planner calls its orientation filter."""

import math
from enum import IntEnum

import numpy as np

from nav_bundle.core.planner import Path
from nav_bundle.core.pose import Pose, angle_difference

_BEND = 0.35
"""A path that bends more than this [rad] between two poses is not straight any more, as in global_planner."""


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
    """Returns ``path`` (n, 3) with headings by ``mode``; the last pose keeps the goal's.

    Args:
        path: from the robot to the goal.
        start: the robot's pose.
        mode: along the path, against it or across it; or evenly from the robot's heading to the goal's; or along the
            path up to its last straight part, and evenly from there.
        window: how many poses to either side say where the path leads.
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
    """Returns where the last straight part of a path begins."""
    index = max(len(path) - 3, 0)
    last = float(path[index, 2])
    while index > 0 and abs(angle_difference(float(path[index - 1, 2]), last)) <= _BEND:
        index -= 1
    return index


def _interpolate(path: Path, start: Pose, first: int) -> None:
    """Turns evenly from the heading at ``first``, the robot's at the path's begin, to that of the goal."""
    begin = start.yaw if first == 0 else float(path[first, 2])
    turn = angle_difference(float(path[-1, 2]), begin)
    path[first:, 2] = begin + turn * np.linspace(0.0, 1.0, len(path) - first)
