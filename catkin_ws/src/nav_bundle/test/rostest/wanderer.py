"""Wandering for a robot that does not know where it is: it uses only its laser and drives where there is room."""

import math

import numpy as np
from numpy.typing import NDArray

SPEED, TURN = 0.5, 0.8
"""[m/s], [rad/s]."""
HALF_WIDTH = 0.45
"""Half the width of the lane that must be free ahead [m]: the robot can turn anywhere in it; its tail needs 0.36 m."""
NEAR, FAR = 0.7, 0.9
"""Room ahead [m, from the laser] below which the robot turns, and above which it drives on."""


class Wanderer:
    """Drives straight while there is room ahead, otherwise turns to the freer side until there is."""

    def __init__(self) -> None:
        self._side = 0

    def command(
        self, ranges: NDArray[np.floating], bearings: NDArray[np.floating]
    ) -> tuple[float, float]:
        """Returns speed [m/s] and turn rate [rad/s] for a scan: ``ranges`` [m] at ``bearings`` [rad, 0 is ahead]."""
        seen = np.where(np.isfinite(ranges), ranges, 30.0)
        lane = (np.abs(seen * np.sin(bearings)) < HALF_WIDTH) & (np.abs(bearings) < math.pi / 2)
        room = (seen * np.cos(bearings))[lane].min(initial=30.0)
        if room > FAR:
            self._side = 0
        elif room < NEAR and self._side == 0:
            left, right = (
                seen[(side * bearings > 0.3) & (side * bearings < 1.5)].mean() for side in (1, -1)
            )
            self._side = 1 if left > right else -1
        return (0.0, self._side * TURN) if self._side else (SPEED, 0.0)
