"""Whether a robot can start at a place of a map."""

from dataclasses import dataclass

from pioneer_gazebo.core.error import SimulatorError

CLEARANCE = 0.2
"""Half a Pioneer's width [m]: nearer to a wall its centre cannot be."""


class PlacementError(SimulatorError):
    """An initial pose at which no robot can start."""


@dataclass(frozen=True, slots=True)
class DrawnMap:
    """A map's image as its file has it."""

    #: x, y: its lower left corner in ``map`` [m]
    x: float
    y: float
    resolution: float  #: side of a cell [m]
    #: rows, cols: its size
    rows: int
    cols: int
    pixels: bytes  #: a byte a cell, the row of the largest y first
    free: int  #: a cell with this value or a larger one is free
    occupied: int  #: a cell with this value or a smaller one is occupied; between the two nothing is known

    def value_at(self, row: int, col: int) -> int | None:
        """Returns the value of a cell, counted from the smallest x and y; None outside the map."""
        if not (0 <= row < self.rows and 0 <= col < self.cols):
            return None
        return self.pixels[(self.rows - 1 - row) * self.cols + col]


def check_place(drawn: DrawnMap, robot: str, x: float, y: float, world: str) -> None:
    """Checks that ``robot`` can start at x, y [m] in ``map``.

    Raises:
        PlacementError: the place is outside the map, inside a wall, or where the map knows nothing.
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
