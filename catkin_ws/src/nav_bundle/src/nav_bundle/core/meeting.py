"""Care in front of what the map does not know: it may be another robot that comes to meet this one."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core.pose import Pose

_FRONT = 0.5
"""Cosine of 60 degrees: what lies farther to the side is not in front."""


@dataclass(frozen=True)
class Care:
    """How to meet: the speed is held to ``scale`` [1/s] times the distance beyond ``margin`` [m].

    So two robots that meet have time to give way. It is never held below ``slowest`` [m/s].
    """

    margin: float = 0.5
    scale: float = 0.4
    slowest: float = 0.15

    def speed(self, unmapped: NDArray[np.float64], pose: Pose) -> float:
        """Returns how fast to go [m/s] for the unmapped obstacles (n, 2) [m] in front, infinity without any."""
        ahead = unmapped - (pose.x, pose.y)
        along = ahead @ (math.cos(pose.yaw), math.sin(pose.yaw))
        distance = np.hypot(ahead[:, 0], ahead[:, 1])
        in_front = distance[along > _FRONT * distance]
        if not len(in_front):
            return math.inf
        return max(self.slowest, self.scale * (float(in_front.min()) - self.margin))
