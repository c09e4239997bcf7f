"""Reads SDF populations: copies of one model in a box or cylinder."""

import math
import random
from collections.abc import Iterator

from pioneer_gazebo.world.element import Element
from pioneer_gazebo.world.pose import Pose, Vector

MOST = 10_000
"""Maximum number of models of a population."""

FARTHEST = 1e5
"""Maximum width of the region of a population [m]."""

KINDS = ("random", "uniform", "grid", "linear-x", "linear-y", "linear-z")


def places_from_sdf(element: Element) -> list[Pose]:
    """Returns where the models of a ``<population>`` are, in its world.

    As in Gazebo, positions are relative to the population, and orientations are those of the model. ``random`` draws
    them with the population's name as seed, so that each run has the same. ``uniform`` fills rows and columns evenly,
    where Gazebo searches evenly spread random places.

    Raises:
        DescriptionError: a value is missing or invalid.
    """
    kind = element.word("distribution/type", "random")
    if kind not in KINDS:
        raise element.needed("distribution").error(
            f"type must be one of {', '.join(KINDS)}, not {kind!r}"
        )
    base = element.placed()
    points = list(_grid(element) if kind == "grid" else _in_region(element, kind))
    return [base.compose(Pose(point)) for point in points]


def _count(element: Element, tag: str) -> int:
    count = element.integer(tag)
    if not 0 < count <= MOST:
        raise element.needed(tag).error(f"must be 1 to {MOST}, not {count}")
    return count


def _grid(element: Element) -> Iterator[Vector]:
    distribution = element.needed("distribution")
    rows, columns = _count(distribution, "rows"), _count(distribution, "cols")
    if rows * columns > MOST:
        raise distribution.error(f"rows * cols must be at most {MOST}, not {rows * columns}")
    step = distribution.needed("step").vector()
    for row in range(rows):
        for column in range(columns):
            x = (column - (columns - 1) / 2) * step[0]
            y = (row - (rows - 1) / 2) * step[1]
            yield x, y, 0.0


def _in_region(element: Element, kind: str) -> Iterator[Vector]:
    count = _count(element, "model_count")
    box, cylinder = element.child("box"), element.child("cylinder")
    chance = random.Random(element.attribute("name", "population"))
    if box is not None:
        size = box.needed("size").vector()
        radius = math.inf
    elif cylinder is not None:
        radius = cylinder.positive("radius")
        size = 2 * radius, 2 * radius, cylinder.positive("length")
    else:
        raise element.error("needs a <box> or a <cylinder>")
    if not 0 <= min(size) <= max(size) <= FARTHEST:
        raise element.error(f"box or cylinder must be 0 to {FARTHEST:g} m wide, not {size}")
    if kind == "random":
        yield from _random(chance, count, size, radius)
    elif kind == "uniform":
        yield from _even(count, size, radius)
    else:
        yield from _line("xyz".index(kind[-1]), count, size)


def _random(chance: random.Random, count: int, size: Vector, radius: float) -> Iterator[Vector]:
    for _ in range(count):
        while True:
            x, y, z = (chance.uniform(-side / 2, side / 2) for side in size)
            if math.hypot(x, y) <= radius:
                break
        yield x, y, z


def _even(count: int, size: Vector, radius: float) -> Iterator[Vector]:
    """Yields points that are evenly spread over the area; in a circle on a spiral."""
    if math.isfinite(radius):
        golden = math.pi * (3.0 - math.sqrt(5.0))
        for number in range(count):
            distance = radius * math.sqrt((number + 0.5) / count)
            yield distance * math.cos(number * golden), distance * math.sin(number * golden), 0.0
        return
    width, depth, _ = size
    columns = max(1, min(count, round(math.sqrt(count * width / depth)) if depth > 0 else count))
    rows = math.ceil(count / columns)
    for number in range(count):
        row, column = divmod(number, columns)
        yield ((column + 0.5) / columns - 0.5) * width, ((row + 0.5) / rows - 0.5) * depth, 0.0


def _line(axis: int, count: int, size: Vector) -> Iterator[Vector]:
    for number in range(count):
        point = [0.0, 0.0, 0.0]
        point[axis] = ((number + 0.5) / count - 0.5) * size[axis]
        yield point[0], point[1], point[2]
