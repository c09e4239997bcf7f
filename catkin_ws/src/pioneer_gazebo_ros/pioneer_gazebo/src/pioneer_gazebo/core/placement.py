"""Checks whether a robot can start at a position in a map."""

from dataclasses import dataclass

from pioneer_gazebo.core.error import SimulatorError

CLEARANCE = 0.2
"""Half a Pioneer's width [m]: the minimum distance of its centre from walls."""


class PlacementError(SimulatorError):
    """A robot cannot start at its initial pose."""


@dataclass(frozen=True, slots=True)
class DrawnMap:
    """The content of a map's image."""

    #: x, y: lower left corner in ``map`` [m]
    x: float
    y: float
    resolution: float  #: side of a cell [m]
    #: rows, cols: size
    rows: int
    cols: int
    pixels: bytes  #: one byte per cell, row with the largest y first
    free: int  #: minimum value of a free cell
    occupied: int  #: maximum value of an occupied cell; values in between are unknown

    def value_at(self, row: int, col: int) -> int | None:
        """Returns the value of a cell, counted from the smallest x and y; None outside the map."""
        if not (0 <= row < self.rows and 0 <= col < self.cols):
            return None
        return self.pixels[(self.rows - 1 - row) * self.cols + col]


def check_place(drawn: DrawnMap, robot: str, x: float, y: float, world: str) -> None:
    """Checks that ``robot`` can start at x, y [m] in ``map``.

    Raises:
        PlacementError: the position is outside the map, too close to a wall, or in unknown space.
    """
    pose = f"{robot} cannot start at ({x:g}, {y:g}) in the world {world}"
    row, col = int((y - drawn.y) // drawn.resolution), int((x - drawn.x) // drawn.resolution)
    value = drawn.value_at(row, col)
    if value is None:
        right, top = drawn.x + drawn.cols * drawn.resolution, drawn.y + drawn.rows * drawn.resolution
        spans = f"x from {drawn.x:g} to {right:g} and y from {drawn.y:g} to {top:g} m"
        raise PlacementError(f"{pose}: that is outside its map, which spans {spans}")
    reach = int(CLEARANCE / drawn.resolution)
    around = range(-reach, reach + 1)
    near = (drawn.value_at(row + up, col + right) for up in around for right in around if up**2 + right**2 <= reach**2)
    if any(cell is not None and cell <= drawn.occupied for cell in near):
        raise PlacementError(f"{pose}: that is inside a wall, or less than {CLEARANCE:g} m from one")
    if value < drawn.free:
        raise PlacementError(f"{pose}: that is outside its walls, in unknown space")
