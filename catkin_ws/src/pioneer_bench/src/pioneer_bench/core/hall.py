"""The hall in which the simulator is measured: 20 × 20 m with box walls."""

import math
import random

from pioneer_bench.core.accuracy import standing
from pioneer_gazebo.world.model import Box, World
from pioneer_gazebo.world.pose import Pose

SIDE = 20.0
"""Inner side of the hall [m]."""

WALLS = 53
"""Number of boxes, including the four outer walls."""

SPACING = 2.5
"""Distance between start positions [m]."""


def starts() -> list[tuple[float, float]]:
    """Returns the possible start positions [m]: the centres of squares that no inner wall enters."""
    count = int(SIDE / SPACING)
    first = -SIDE / 2 + SPACING / 2
    return [
        (first + column * SPACING, first + row * SPACING)
        for row in range(count)
        for column in range(count)
    ]


def world(seed: int) -> World:
    """Returns the hall; its inner walls lie on the lines between the starts, chosen by ``seed``."""
    half, long = SIDE / 2 + 0.05, SIDE + 0.2
    walls = [
        (half, 0.0, math.pi / 2, long),
        (-half, 0.0, math.pi / 2, long),
        (0.0, half, 0.0, long),
    ]
    walls.append((0.0, -half, 0.0, long))
    lines = int(SIDE / SPACING) - 1
    sites = [
        (line, place, turned)
        for line in range(lines)
        for place in range(lines + 1)
        for turned in (False, True)
    ]
    for line, place, turned in random.Random(seed).sample(sites, WALLS - len(walls)):
        across = -SIDE / 2 + (line + 1) * SPACING
        along = -SIDE / 2 + (place + 0.5) * SPACING
        walls.append((across, along, math.pi / 2, 1.2) if turned else (along, across, 0.0, 1.2))
    return World(
        "hall",
        tuple(
            standing(f"wall_{number}", Pose.from_rpy(x, y, 0.5, yaw=yaw), Box((length, 0.1, 1.0)))
            for number, (x, y, yaw, length) in enumerate(walls)
        ),
    )
