"""A maze of loose boxes, as in worlds whose author forgot ``<static>``."""

import random

from pioneer_bench.core.accuracy import floor
from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.core.world import Box, Collision, Inertia, Link, Model, World

BOXES, COLUMNS = 285, 19
PITCH = 1.4
LENGTH, WIDTH, HEIGHT = 1.0, 0.15, 1.0
"""Size of a box [m]."""


def loose_maze() -> World:
    """Returns the maze, always the same one."""
    chance = random.Random(1)
    boxes = []
    for number in range(BOXES):
        row, column = divmod(number, COLUMNS)
        size = (LENGTH, WIDTH, HEIGHT) if chance.random() < 0.5 else (WIDTH, LENGTH, HEIGHT)
        link = Link("link", mass=10.0, inertia=Inertia(), collisions=(Collision("c", Pose(), Box(size)),))
        pose = Pose(((column - COLUMNS / 2) * PITCH, (row - BOXES / COLUMNS / 2) * PITCH, HEIGHT / 2))
        boxes.append(Model(f"box_{number}", pose, links=(link,)))
    return World("285 loose boxes", (floor(), *boxes))
