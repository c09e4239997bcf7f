"""Points from laser ranges."""

import functools

import numpy as np
from numpy.typing import NDArray

_SHORT_OF_MAXIMUM = 1.0e-4


def points_from_ranges(
    ranges: NDArray[np.float32],
    first_angle: float,
    angle_step: float,
    shortest: float,
    longest: float,
    inf_is_valid: bool,
) -> NDArray[np.float64]:
    """Converts laser returns to points (n, 3) [m] in the sensor's frame; ranges without a return give no point.

    With ``inf_is_valid``, an infinite range gives a point just short of ``longest`` [m].
    """
    if inf_is_valid:
        ranges = np.where(np.isposinf(ranges), np.float32(longest - _SHORT_OF_MAXIMUM), ranges)
    directions = _directions(len(ranges), first_angle, angle_step)
    valid = (ranges >= shortest) & (ranges < longest)
    return directions[valid] * ranges[valid, None]


@functools.lru_cache(maxsize=8)
def _directions(count: int, first_angle: float, angle_step: float) -> NDArray[np.float64]:
    angles = first_angle + angle_step * np.arange(count)
    return np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
