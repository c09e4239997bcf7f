"""Courses for one robot: obstacles, which of them the map shows, and the goals."""

import math
from dataclasses import dataclass

import numpy as np

from nav_bundle.base.pose import Pose
from nav_bundle.maps.grid import FREE, OCCUPIED, Grid
from pioneer_gazebo.commands.raster import Extent, occupied_cells
from pioneer_gazebo.world.section import EMPTY, Section

_RESOLUTION = 0.05
_THICKNESS = 0.1
"""Thickness of walls [m]."""
_MARGIN = 0.5
_ROOM_FOR_ROBOT = 0.75
"""Minimum distance of a start or goal from obstacles [m]."""


@dataclass(frozen=True, eq=False)
class Change:
    """A change of what stands: it happens once, when the robot comes near a place on its way to a goal."""

    leg: int  #: index of the goal
    x: float  #: place that the robot comes near [m]
    y: float
    distance: float  #: how near [m]
    hidden: (
        Section  #: what the map does not show from then on, in place of what it did not show before
    )


@dataclass(frozen=True, eq=False)
class Course:
    """One course."""

    walls: tuple[Section, ...]  #: outlines of the solids that the map shows
    start: Pose  #: of the robot
    goals: tuple[Pose, ...]  #: visited in this order
    hidden: Section = EMPTY  #: obstacles that the map does not show
    low: Section = EMPTY  #: obstacles below the laser
    limit: float = 120.0  #: time for all goals [s]
    changes: tuple[Change, ...] = ()  #: in any order
    unreachable: frozenset[int] = frozenset()  #: indices of goals that cannot be reached

    @property
    def standing(self) -> Section:
        """All obstacles that the laser sees."""
        return Section.joined([*self.walls, self.hidden])

    def grid(self) -> Grid:
        """Returns the map."""
        extent = Extent.around(self.walls, _RESOLUTION, _MARGIN)
        assert extent is not None
        cells = np.where(occupied_cells(self.walls, extent), OCCUPIED, FREE).astype(np.int8)
        return Grid(_RESOLUTION, Pose(extent.x, extent.y), cells)


def box(x_0: float, y_0: float, x_1: float, y_1: float) -> Section:
    """Returns the outline of an upright rectangle [m]."""
    corners = np.array([[x_0, y_0], [x_1, y_0], [x_1, y_1], [x_0, y_1]])
    return Section(np.hstack([corners, np.roll(corners, -1, axis=0) - corners]), np.empty((0, 3)))


def wall(x_0: float, y_0: float, x_1: float, y_1: float) -> Section:
    """Returns the outline of a wall along a line parallel to an axis [m]."""
    half = _THICKNESS / 2.0
    return box(
        min(x_0, x_1) - half, min(y_0, y_1) - half, max(x_0, x_1) + half, max(y_0, y_1) + half
    )


def room(width: float, height: float) -> list[Section]:
    """Returns the four walls of a room whose inside begins at the origin [m]."""
    half = _THICKNESS / 2.0
    right, top = width + half, height + half
    return [
        wall(-half, -half, right, -half), wall(-half, top, right, top), wall(-half, -half, -half, top),
        wall(right, -half, right, top),
    ]  # fmt: skip


def clutter(seed: int, count: int = 30, side: float = 12.0, goals: int = 8) -> Course:
    """Returns a square room with cylinders of 8 to 15 cm radius that the map does not show."""
    generator = np.random.default_rng(seed)
    circles: list[tuple[float, float, float]] = []
    while len(circles) < count:
        x, y, radius = generator.uniform((0.5, 0.5, 0.08), (side - 0.5, side - 0.5, 0.15))
        if all(
            math.hypot(x - other[0], y - other[1]) - radius - other[2] > 0.9 for other in circles
        ):
            circles.append((x, y, radius))
    places: list[Pose] = []
    while len(places) < goals + 1:
        x, y, yaw = generator.uniform((0.8, 0.8, -math.pi), (side - 0.8, side - 0.8, math.pi))
        free = all(
            math.hypot(x - cx, y - cy) - radius > _ROOM_FOR_ROBOT for cx, cy, radius in circles
        )
        if free and (not places or 3.0 < places[-1].distance(Pose(x, y)) < 9.0):
            places.append(Pose(x, y, yaw))
    hidden = Section(np.empty((0, 4)), np.array(circles).reshape(-1, 3))
    return Course(tuple(room(side, side)), places[0], tuple(places[1:]), hidden)


def doors(width: float = 0.7) -> Course:
    """Returns five rooms in a row, joined by four doors; the robot drives there and back."""
    side, count = 4.0, 5
    walls = room(side * count, side)
    for index in range(1, count):
        middle = 1.2 if index % 2 else side - 1.2
        walls += [
            wall(index * side, 0.0, index * side, middle - width / 2.0 - _THICKNESS / 2.0),
            wall(index * side, middle + width / 2.0 + _THICKNESS / 2.0, index * side, side),
        ]
    there = [Pose((index + 0.5) * side, side / 2.0) for index in range(1, count)]
    back = [Pose(pose.x, pose.y) for pose in reversed([Pose(side / 2.0, side / 2.0), *there[:-1]])]
    return Course(tuple(walls), Pose(side / 2.0, side / 2.0), (*there, *back))


def slalom(gap: float = 1.5) -> Course:
    """Returns a corridor with walls from alternate sides, each leaving a gap of ``gap`` [m]."""
    length, height = 16.0, 4.0
    walls = room(length, height)
    for index, x in enumerate(np.arange(2.5, length - 1.0, 2.5)):
        walls.append(wall(x, 0.0, x, height - gap) if index % 2 else wall(x, gap, x, height))
    ends = Pose(1.0, 2.0), Pose(length - 1.0, 2.0)
    return Course(tuple(walls), ends[0], (ends[1], ends[0]))


def corridor(width: float = 1.0, length: float = 20.0) -> Course:
    """Returns a straight corridor; the robot drives there and back."""
    ends = Pose(1.0, width / 2.0), Pose(length - 1.0, width / 2.0)
    return Course(tuple(room(length, width)), ends[0], (ends[1], ends[0]))


def unreachable() -> Course:
    """Returns a room with a closed chamber that contains the goal."""
    walls = [*room(8.0, 6.0), wall(5.0, 2.0, 7.0, 2.0), wall(5.0, 4.0, 7.0, 4.0)]
    walls += [wall(5.0, 2.0, 5.0, 4.0), wall(7.0, 2.0, 7.0, 4.0)]
    return Course(tuple(walls), Pose(1.5, 3.0), (Pose(6.0, 3.0),), unreachable=frozenset({0}))


def doorstep() -> Course:
    """Returns a room divided by a box below the laser: the goal cannot be reached."""
    low = box(4.0, 0.0, 4.2, 5.0)
    walls = tuple(room(8.0, 5.0))
    return Course(walls, Pose(1.5, 2.5), (Pose(6.5, 2.5),), low=low, unreachable=frozenset({0}))


def maze(seed: int, legs: int = 4, cells: int = 6) -> Course:
    """Returns a maze of square cells with some loops and passages 1.1 to 1.9 m wide."""
    generator = np.random.default_rng(seed)
    pitch = float(generator.uniform(1.2, 2.0))
    closed = _maze_walls(generator, cells)
    walls = room(cells * pitch, cells * pitch)
    for first, second in closed:
        row, col = max(first, second)
        if first[0] == second[0]:
            walls.append(wall(col * pitch, row * pitch, col * pitch, (row + 1) * pitch))
        else:
            walls.append(wall(col * pitch, row * pitch, (col + 1) * pitch, row * pitch))
    chosen = generator.permutation(cells * cells)[: legs + 1]
    places = [
        Pose((index % cells + 0.5) * pitch, (index // cells + 0.5) * pitch)
        for index in map(int, chosen)
    ]
    start = Pose(places[0].x, places[0].y, float(generator.uniform(-math.pi, math.pi)))
    return Course(tuple(walls), start, tuple(places[1:]), limit=150.0 * legs)


Cell = tuple[int, int]


def _maze_walls(generator: np.random.Generator, cells: int) -> set[tuple[Cell, Cell]]:
    """Returns the pairs of neighbouring cells with a wall between them: those of a random spanning tree, less some."""
    across = {((r, c), (r, c + 1)) for r in range(cells) for c in range(cells - 1)}
    up = {((r, c), (r + 1, c)) for r in range(cells - 1) for c in range(cells)}
    closed, seen, stack = across | up, {(0, 0)}, [(0, 0)]
    while stack:
        row, col = stack[-1]
        around = [(row, col + 1), (row, col - 1), (row + 1, col), (row - 1, col)]
        fresh = [n for n in around if 0 <= n[0] < cells and 0 <= n[1] < cells and n not in seen]
        if not fresh:
            stack.pop()
            continue
        chosen = fresh[int(generator.integers(len(fresh)))]
        closed.discard((min(stack[-1], chosen), max(stack[-1], chosen)))
        seen.add(chosen)
        stack.append(chosen)
    ordered = sorted(closed)
    opened = generator.permutation(len(ordered))[: len(ordered) // 8]
    return closed - {ordered[int(index)] for index in opened}
