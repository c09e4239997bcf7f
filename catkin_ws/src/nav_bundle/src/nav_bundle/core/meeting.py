"""Care in front of what the map does not know: it may be another robot that comes to meet this one."""

import math

import numpy as np

from nav_bundle.core.local_planner import Situation

# With unmapped obstacles in front (within 60 degrees), the speed [m/s] is held to 0.4/s times the distance
# beyond 0.5 m, so that two robots that meet have time to give way.
_FRONT, _SPEED_BY_DISTANCE, _MARGIN, _SLOWEST = 0.5, 0.4, 0.5, 0.15


def careful_speed(situation: Situation) -> float:
    """Returns the highest speed [m/s] for the unmapped obstacles in front, infinity without any."""
    ahead = situation.unmapped - (situation.pose.x, situation.pose.y)
    along = ahead @ (math.cos(situation.pose.yaw), math.sin(situation.pose.yaw))
    distance = np.hypot(ahead[:, 0], ahead[:, 1])
    in_front = distance[along > _FRONT * distance]
    if not len(in_front):
        return math.inf
    return max(_SLOWEST, _SPEED_BY_DISTANCE * (float(in_front.min()) - _MARGIN))
