"""Speed limit in front of unmapped obstacles, which may be oncoming robots."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core.pose import Pose

_FRONT = 0.5
"""Cosine of 60 degrees: obstacles farther to the side do not count as in front."""


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
