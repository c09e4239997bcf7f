"""Converts floor plans drawn with characters to worlds.

A drawing has a grid corner every ``4`` characters across and every ``2`` lines down; walls run between corners::

    +---+---+
    |   | o |      |  and  ---   a wall on the side of a cell
    +   +---+      o             a round pillar in the middle of a cell
    |     # |      #             a solid cell
    +---+---+

Lines ``name: value`` precede the drawing, separated from it by a line ``---``. The top of the drawing is north.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.model import Box, Collision, Cylinder, Link, Model, Shape, Visual, World
from pioneer_gazebo.world.pose import IDENTITY, Pose

ACROSS, DOWN = 4, 2


@dataclass(frozen=True, slots=True)
class Measures:
    """The measures in the head of a plan, all in metres."""

    cell: float = 1.0  #: side of a cell
    x: float = 0.0  #: x of the drawing's lower left corner
    y: float = 0.0  #: y of the drawing's lower left corner
    thickness: float = 0.1  #: wall thickness
    height: float = 0.8  #: height of walls, pillars and solid cells
    pillar: float = 0.2  #: radius of a pillar


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """A drawing and its measures; ``rows`` run from north to south."""

    measures: Measures
    rows: tuple[str, ...]

    @property
    def cells(self) -> tuple[int, int]:
        """Number of rows and columns of cells."""
        return len(self.rows) // DOWN, max((len(row) for row in self.rows), default=0) // ACROSS

    def at(self, row: float, col: float) -> str:
        """Returns the character at a position in cells from the upper left corner; blank outside the drawing.

        The middle of a cell's upper side is (row, col + 0.5), that of its left side (row + 0.5, col).
        """
        line = self.rows[int(row * DOWN)] if row * DOWN < len(self.rows) else ""
        return line[int(col * ACROSS)] if col * ACROSS < len(line) else " "


def plan_from_text(text: str, source: str = "plan") -> FloorPlan:
    """Returns the plan written in ``text``.

    Raises:
        DescriptionError: a measure is unknown or not a number, or there is no drawing.
    """
    lines = text.splitlines()
    if "---" not in lines:
        raise DescriptionError(
            f"{source}: a line --- must stand between the measures and the drawing"
        )
    split = lines.index("---")
    values: dict[str, float] = {}
    known = [field.name for field in fields(Measures)]
    for number, line in enumerate(lines[:split], 1):
        if not line.strip() or line.startswith("#"):
            continue
        name, _, value = (part.strip() for part in line.partition(":"))
        if name not in known:
            raise DescriptionError(
                f"{source}, line {number}: {name!r} is not one of {', '.join(known)}"
            )
        try:
            values[name] = float(value)
        except ValueError:
            raise DescriptionError(
                f"{source}, line {number}: {name}: {value!r} is not a number"
            ) from None
    rows = tuple(line.rstrip() for line in lines[split + 1 :])
    while rows and not rows[-1]:
        rows = rows[:-1]
    if len(rows) < DOWN + 1:
        raise DescriptionError(f"{source}: the drawing has no cell")
    return FloorPlan(Measures(**values), rows)


def world_of_plan(plan: FloorPlan, name: str, ground: Model) -> World:
    """Returns the plan's world: ``ground``, and a static model ``walls`` of boxes and pillars.

    Collinear adjoining walls become one box, which extends over the corners at its ends.
    """
    solids = list(_solids(plan))
    if not solids:
        return World(name, (ground,))
    collisions = tuple(
        Collision(f"collision_{i}", pose, shape) for i, (pose, shape) in enumerate(solids)
    )
    visuals = tuple(
        Visual(f"visual_{i}", pose, shape, (0.75, 0.73, 0.68, 1.0))
        for i, (pose, shape) in enumerate(solids)
    )
    link = Link("link", IDENTITY, collisions=collisions, visuals=visuals)
    return World(name, (ground, Model("walls", IDENTITY, static=True, links=(link,))))


Solid = tuple[Pose, Shape]


def _box(plan: FloorPlan, west: float, south: float, east: float, north: float) -> Solid:
    """Returns a box over a rectangle, in cells from the drawing's lower left corner, extended by half a wall."""
    m = plan.measures
    size = ((east - west) * m.cell + m.thickness, (north - south) * m.cell + m.thickness, m.height)
    x, y = m.x + (west + east) / 2 * m.cell, m.y + (south + north) / 2 * m.cell
    return Pose((round(x, 6), round(y, 6), m.height / 2)), Box(
        (round(size[0], 6), round(size[1], 6), size[2])
    )


def _runs(flags: list[bool]) -> list[tuple[int, int]]:
    """Returns the half-open ranges in which ``flags`` is true."""
    edges = [
        i
        for i in range(len(flags) + 1)
        if (i > 0 and flags[i - 1]) != (i < len(flags) and flags[i])
    ]
    return list(zip(edges[::2], edges[1::2], strict=True))


def _solids(plan: FloorPlan) -> Iterator[Solid]:
    """Yields horizontal walls, vertical walls, solid cells and pillars."""
    rows, cols = plan.cells
    m = plan.measures
    for row in range(rows + 1):
        for start, end in _runs([plan.at(row, col + 0.5) == "-" for col in range(cols)]):
            yield _box(plan, start, rows - row, end, rows - row)
    for col in range(cols + 1):
        for start, end in _runs([plan.at(row + 0.5, col) == "|" for row in range(rows)]):
            yield _box(plan, col, rows - end, col, rows - start)
    for row in range(rows):
        # Neighbours in a row become one box that ends at the cell borders.
        for start, end in _runs([plan.at(row + 0.5, col + 0.5) == "#" for col in range(cols)]):
            pose, _ = _box(plan, start, rows - row - 1, end, rows - row)
            yield pose, Box((round((end - start) * m.cell, 6), m.cell, m.height))
    for row in range(rows):
        for col in range(cols):
            if plan.at(row + 0.5, col + 0.5) == "o":
                x, y = m.x + (col + 0.5) * m.cell, m.y + (rows - row - 0.5) * m.cell
                yield Pose((round(x, 6), round(y, 6), m.height / 2)), Cylinder(m.pillar, m.height)
