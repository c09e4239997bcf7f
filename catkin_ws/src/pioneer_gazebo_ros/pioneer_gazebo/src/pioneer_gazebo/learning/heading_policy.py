"""A small learned driver: scores headings by a few features of scan and goal, and drives along the best one."""

import math

import numpy as np
from numpy.typing import NDArray

SECTORS = 36
"""Number of directions."""
REACH = 4.0
"""Ranges are clipped to this [m]."""
_EXACT = 1.0e-6
_WIDE = 0.30
"""Half the width required for a path [m]."""

START = (0.1, 0.1, 0.5, 0.3, 1.0)
"""Weights before training: of a heading's clearance and of straight ahead, relative to 1 for the goal's direction;
gains of turn and speed; distance at which it slows down for an obstacle [m]."""


def sectors(ranges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the smallest range [m] in each of `SECTORS` directions, starting straight behind.

    Args:
        ranges: of a 360° scan, anticlockwise from straight behind [m].
    """
    return np.minimum(
        np.minimum.reduceat(ranges, np.arange(SECTORS) * len(ranges) // SECTORS), REACH
    )


def directions() -> NDArray[np.float64]:
    """Returns the centre of each sector, in the robot's frame [rad]."""
    return (np.arange(SECTORS) + 0.5) * 2.0 * math.pi / SECTORS - math.pi


_ANGLES = directions()
_BETWEEN = np.abs((_ANGLES[:, None] - _ANGLES[None, :] + math.pi) % (2.0 * math.pi) - math.pi)


def act(
    weights: NDArray[np.float64], ranges: NDArray[np.float64], distance: float, bearing: float
) -> tuple[float, float]:
    """Returns fractions of the maximum speed and turn rate, -1 … 1.

    Args:
        weights: see `START`.
        ranges: of a 360° scan, anticlockwise from straight behind [m].
        distance: to the goal [m].
        bearing: of the goal, in the robot's frame [rad].
    """
    near = sectors(ranges)
    # A direction is clear up to the nearest obstacle that a robot of this width would hit.
    beside = near[None, :] * np.sin(np.minimum(_BETWEEN, math.pi / 2.0)) < _WIDE
    along = np.where(beside & (math.pi / 2.0 > _BETWEEN), near[None, :] * np.cos(_BETWEEN), REACH)
    clear = np.minimum(along.min(axis=1), max(distance, 0.5))
    clearance, ahead, turn, speed, slow = weights
    score = (
        clearance * clear / min(REACH, max(distance, 0.5))
        + np.cos(_ANGLES - bearing)
        + ahead * np.cos(_ANGLES)
    )
    best = float(_ANGLES[score.argmax()])
    if abs(math.remainder(best - bearing, math.tau)) <= math.pi / SECTORS + _EXACT:
        best = bearing
    front = float(along[SECTORS // 2 - 1 : SECTORS // 2 + 1].min())
    forwards = speed * max(0.0, math.cos(best)) * min(1.0, max(0.0, front - 0.35) / slow)
    return float(np.clip(forwards, -1.0, 1.0)), float(np.clip(turn * best, -1.0, 1.0))
