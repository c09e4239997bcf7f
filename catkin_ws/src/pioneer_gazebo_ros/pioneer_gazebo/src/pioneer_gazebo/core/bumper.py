"""Bumper rings: which segments of a robot's front and rear are pressed."""

import math
from collections.abc import Iterable

SEGMENTS = 5
"""Of each ring, from the robot's left to its right; they share its half evenly."""


def pressed(bearings: Iterable[float]) -> tuple[list[bool], list[bool]]:
    """Returns the front and the rear ring's segments.

    Args:
        bearings: of the contacts from the robot's middle [rad], 0 ahead, to the left positive.
    """
    rings = [False] * SEGMENTS, [False] * SEGMENTS
    for bearing in bearings:
        from_left = math.remainder(bearing, math.tau)
        behind = abs(from_left) > math.pi / 2
        part = (from_left % math.tau - math.pi / 2) if behind else (math.pi / 2 - from_left)
        rings[behind][min(SEGMENTS - 1, max(0, int(part / math.pi * SEGMENTS)))] = True
    return rings
