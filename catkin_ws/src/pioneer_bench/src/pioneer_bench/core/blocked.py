"""Courses on which something that the map does not show is in the way, drawn by seed."""

import math

import numpy as np

from nav_bundle.base.pose import Pose
from pioneer_bench.core.course import Change, Course, box, room, wall
from pioneer_gazebo.world.section import EMPTY, Section

_LENGTH, _HEIGHT = 12.0, 8.0
"""Size of the room [m]; the robot starts on the left, and the goal is on the right."""
_BEFORE, _BEHIND = 1.5, 10.5
_DOOR = 1.2
"""Width of a door [m]."""


def _ends(generator: np.random.Generator) -> tuple[Pose, Pose]:
    """Returns a start on the left and a goal on the right."""
    here, there = generator.uniform(2.0, _HEIGHT - 2.0, 2)
    return Pose(_BEFORE, float(here), float(generator.uniform(-math.pi, math.pi))), Pose(
        _BEHIND, float(there)
    )


def barrier(seed: int) -> Course:
    """Returns a room that a hidden wall divides: the goal behind it cannot be reached, the one before it can."""
    generator = np.random.default_rng(seed)
    start, goal = _ends(generator)
    x = float(generator.uniform(4.5, 8.0))
    back = Pose(_BEFORE, float(generator.uniform(2.0, _HEIGHT - 2.0)))
    hidden = wall(x, 0.0, x, _HEIGHT)
    walls = tuple(room(_LENGTH, _HEIGHT))
    return Course(walls, start, (goal, back), hidden, limit=240.0, unreachable=frozenset({0}))


def detour(seed: int) -> Course:
    """Returns a room with a hidden wall that leaves a way round at one end."""
    generator = np.random.default_rng(seed)
    start, goal = _ends(generator)
    x = float(generator.uniform(4.5, 8.0))
    gap = float(generator.uniform(1.3, 2.0))
    at_top = bool(generator.integers(2))
    hidden = wall(x, 0.0, x, _HEIGHT - gap) if at_top else wall(x, gap, x, _HEIGHT)
    return Course(
        tuple(room(_LENGTH, _HEIGHT)), start, (goal, Pose(start.x, start.y)), hidden, limit=240.0
    )


def trap(seed: int) -> Course:
    """Returns a room with a hidden U that opens towards the robot."""
    generator = np.random.default_rng(seed)
    start, goal = _ends(generator)
    middle = float(generator.uniform(3.6, 4.4))
    half = float(generator.uniform(1.2, 1.6))
    bottom = float(generator.uniform(6.8, 7.8))
    depth = float(generator.uniform(2.0, 3.2))
    hidden = Section.joined([
        wall(bottom, middle - half, bottom, middle + half),
        wall(bottom - depth, middle - half, bottom, middle - half),
        wall(bottom - depth, middle + half, bottom, middle + half),
    ])  # fmt: skip
    return Course(
        tuple(room(_LENGTH, _HEIGHT)), start, (goal, Pose(start.x, start.y)), hidden, limit=240.0
    )


def shut_door(seed: int) -> Course:
    """Returns two rooms with two doors: one shuts before the robot; on the way back the other one, while it opens."""
    generator = np.random.default_rng(seed)
    x = float(generator.uniform(5.0, 7.0))
    low, high = float(generator.uniform(1.2, 2.0)), float(generator.uniform(6.0, 6.8))
    half = _DOOR / 2.0
    walls = [
        *room(_LENGTH, _HEIGHT),
        wall(x, 0.0, x, low - half),
        wall(x, low + half, x, high - half),
        wall(x, high + half, x, _HEIGHT),
    ]
    first, second = wall(x, low - half, x, low + half), wall(x, high - half, x, high + half)
    changes = (Change(0, x, low, 1.5, first), Change(1, x, high, 1.5, second))
    goals = Pose(_BEHIND, low), Pose(_BEFORE, high)
    return Course(tuple(walls), Pose(_BEFORE, low), goals, EMPTY, limit=240.0, changes=changes)


def occupied(seed: int) -> Course:
    """Returns a room with a hidden box on the first goal."""
    generator = np.random.default_rng(seed)
    start, goal = _ends(generator)
    half = float(generator.uniform(0.4, 0.7))
    hidden = box(goal.x - half, goal.y - half, goal.x + half, goal.y + half)
    free = Pose(6.0, float(generator.uniform(2.0, _HEIGHT - 2.0)))
    walls = tuple(room(_LENGTH, _HEIGHT))
    return Course(walls, start, (goal, free), hidden, limit=240.0, unreachable=frozenset({0}))


def thicket(seed: int) -> Course:
    """Returns two ways round a block; hidden cylinders close the shorter one."""
    generator = np.random.default_rng(seed)
    walls = [*room(_LENGTH, _HEIGHT), box(3.0, 3.0, 9.0, 5.0)]
    circles = []
    for x in np.arange(4.0, 8.0, 0.45):
        for y in np.arange(0.2, 3.0, 0.45):
            shift_x, shift_y = generator.uniform(-0.05, 0.05, 2)
            circles.append((x + shift_x, y + shift_y, float(generator.uniform(0.06, 0.15))))
    hidden = Section(np.empty((0, 4)), np.array(circles))
    start, goal = Pose(_BEFORE, 2.5), Pose(_BEHIND, float(generator.uniform(1.5, 2.5)))
    return Course(tuple(walls), start, (goal, Pose(start.x, start.y)), hidden, limit=240.0)
