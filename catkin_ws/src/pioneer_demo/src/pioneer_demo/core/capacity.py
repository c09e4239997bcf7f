"""Estimates the real-time factor that a machine can sustain for a fleet."""

import math

_ROBOTS_A_PROCESSOR = 6.75
"""Robots, with navigation and gateway, that one processor runs in real time (docs/performance.md)."""


def factor_held(robots: int, processors: float) -> float:
    """Returns the real-time factor at which navigation keeps up, rounded down to a multiple of 0.05; at most 1."""
    return min(1.0, max(0.05, math.floor(20 * _ROBOTS_A_PROCESSOR * processors / robots) / 20))
