"""Bumper rings: which segments of a robot's front and rear are pressed."""

import math
from collections.abc import Iterable

SEGMENTS = 5
"""Number of segments per ring, evenly spaced from the robot's left to its right."""


def pressed(bearings: Iterable[float]) -> tuple[list[bool], list[bool]]:
    """Returns the pressed segments of the front and the rear ring.

    Args:
        bearings: of the contacts as seen from the robot's centre [rad], 0 ahead, positive to the left.
    """
    rings = [False] * SEGMENTS, [False] * SEGMENTS
    for bearing in bearings:
        from_left = math.remainder(bearing, math.tau)
        behind = abs(from_left) > math.pi / 2
        part = (from_left % math.tau - math.pi / 2) if behind else (math.pi / 2 - from_left)
        rings[behind][min(SEGMENTS - 1, max(0, int(part / math.pi * SEGMENTS)))] = True
    return rings
