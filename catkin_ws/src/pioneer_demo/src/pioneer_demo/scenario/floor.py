"""Grid of the drivable floor, and driving distances on it."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

_CROSS = ndimage.generate_binary_structure(2, 1)
_SQUARE = ndimage.generate_binary_structure(2, 2)
_OCCUPIED = 50
"""Occupancy from which a cell counts as occupied [%]."""


@dataclasses.dataclass(frozen=True)
class Floor:
    """A map reduced to free and occupied cells."""

    resolution: float  #: edge of a cell [m]
    #: x, y: position of the outer corner of cell (0, 0) in the frame ``map`` [m]
    x: float
    y: float
    free: NDArray[np.bool_]  #: bool [row, col], row 0 at the smallest y
    occupied: NDArray[
        np.bool_
    ]  #: bool [row, col]; cells that are neither free nor occupied are unknown

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Returns (row, col) of a position, which may lie outside the map."""
        return int(np.floor((y - self.y) / self.resolution)), int(
            np.floor((x - self.x) / self.resolution)
        )

    def position(self, row: Any, col: Any) -> tuple[Any, Any]:
        """Returns (x, y) of a cell's centre [m]; of many cells, given as arrays of rows and columns, arrays."""
        return self.x + (col + 0.5) * self.resolution, self.y + (row + 0.5) * self.resolution

    def contains(self, row: int, col: int) -> bool:
        """Returns whether the cell is inside the map."""
        return 0 <= row < self.free.shape[0] and 0 <= col < self.free.shape[1]

    def clearance(self) -> NDArray[np.float64]:
        """Returns each cell's distance to the nearest cell that is not free [m], float64 [row, col]."""
        distance: NDArray[np.float64] = (
            ndimage.distance_transform_edt(np.pad(self.free, 1)) * self.resolution
        )
        return distance[1:-1, 1:-1]

    def cropped(self) -> "Floor":
        """Returns the map cropped to its known cells."""
        known = self.free | self.occupied
        rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        if not rows.size:
            return self
        part = np.s_[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
        x, y = self.x + cols[0] * self.resolution, self.y + rows[0] * self.resolution
        return Floor(self.resolution, float(x), float(y), self.free[part], self.occupied[part])


def floor_from_cells(cells: NDArray[np.int8], resolution: float, x: float, y: float) -> Floor:
    """Returns the floor of an unrotated map with cells [row, col] as in ``nav_msgs/OccupancyGrid``."""
    occupied = cells >= _OCCUPIED
    return Floor(resolution, x, y, (cells >= 0) & ~occupied, occupied)


def drivable(floor: Floor, clearance: float, cell: float) -> Floor:
    """Returns the floor in cells of about ``cell`` [m], free where a robot's centre keeps ``clearance`` [m].

    A coarse cell is free if its centre is, so that narrow passages are preserved.
    """
    factor = max(1, round(cell / floor.resolution))
    middle = floor.clearance()[factor // 2 :: factor, factor // 2 :: factor]
    free = middle >= clearance
    return Floor(floor.resolution * factor, floor.x, floor.y, free, ~free)


def distances(floor: Floor, row: int, col: int) -> NDArray[np.float64]:
    """Returns the driving distance from (row, col) to each free cell [m]; infinity if unreachable.

    Wavefront expansion with alternating 4- and 8-neighbourhoods: octagonal distance, within 11 % of the true length in
    open space.
    """
    steps = np.full(floor.free.shape, np.inf)
    front = np.zeros(floor.free.shape, bool)
    front[row, col] = True
    reached, travelled = front.copy(), 0.0
    while front.any():
        steps[front] = travelled
        # Two steps, one of each kind, reach 2 cells straight or 1.5 √2 cells diagonally.
        structure = _SQUARE if round(travelled / floor.resolution) % 2 else _CROSS
        grown = ndimage.binary_dilation(reached, structure) & floor.free
        front, reached, travelled = grown & ~reached, reached | grown, travelled + floor.resolution
    return steps


def route(steps: NDArray[np.float64], row: int, col: int) -> list[tuple[int, int]]:
    """Returns the cells of a shortest path from the source of ``steps`` to (row, col), both included.

    Args:
        steps: result of ``distances``.
        row: row of a reachable cell.
        col: its column.
    """
    cells = [(row, col)]
    while steps[row, col] > 0.0:
        rows, cols = slice(max(0, row - 1), row + 2), slice(max(0, col - 1), col + 2)
        window = steps[rows, cols]
        lowest = np.unravel_index(np.argmin(window), window.shape)
        if window[lowest] >= steps[row, col]:
            break
        row, col = rows.start + int(lowest[0]), cols.start + int(lowest[1])
        cells.append((row, col))
    return cells[::-1]
