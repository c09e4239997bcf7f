"""How fast a fleet's simulated time may pass on one machine."""

import math

_ROBOTS_A_PROCESSOR = 6.75
"""As many robots, with their navigation and gateways, a processor carries at real time (docs/performance.md)."""


def factor_held(robots: int, processors: float) -> float:
    """Returns the real-time factor at which navigation keeps up, rounded down to a twentieth; 1 at most."""
    return min(1.0, max(0.05, math.floor(20 * _ROBOTS_A_PROCESSOR * processors / robots) / 20))
