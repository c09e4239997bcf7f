"""Position and size of grids, and windows within them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nav_bundle.costmap.costmap_kernel import Place

Cells = NDArray[np.uint8]


@dataclass
class Geometry:
    """Geometry of a costmap: outer corner of cell (0, 0) [m] in its frame, cell size [m], rows and columns."""

    origin_x: float
    origin_y: float
    resolution: float
    rows: int
    cols: int

    @property
    def place(self) -> Place:
        """Origin and resolution in the form that the kernels use."""
        return Place(self.origin_x, self.origin_y, self.resolution)

    @property
    def everything(self) -> "Window":
        """The window of all cells."""
        return Window(0, self.rows, 0, self.cols)

    def row_of(self, y: float) -> int:
        """Returns the row that contains ``y`` [m], inside the grid or not."""
        return int(np.floor((y - self.origin_y) / self.resolution))

    def col_of(self, x: float) -> int:
        """Returns the column that contains ``x`` [m], inside the grid or not."""
        return int(np.floor((x - self.origin_x) / self.resolution))

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """Returns (row, column) of the cell that contains ``x``, ``y`` [m], inside the grid or not."""
        return self.row_of(y), self.col_of(x)

    def contains(self, cell: tuple[int, int]) -> bool:
        """Returns whether ``cell`` (row, column) is inside the grid."""
        return 0 <= cell[0] < self.rows and 0 <= cell[1] < self.cols

    def window_between(self, x_0: float, y_0: float, x_1: float, y_1: float) -> "Window":
        """Returns the window of the cells that a box [m] touches, inside the grid."""
        (row_0, col_0), (row_1, col_1) = self.cell_at(x_0, y_0), self.cell_at(x_1, y_1)
        return Window(row_0, row_1 + 1, col_0, col_1 + 1).within(self.everything)

    def window_around(self, cell: tuple[int, int], margin: int) -> "Window":
        """Returns the window that reaches ``margin`` cells from ``cell`` to each side, inside the grid."""
        return Window(cell[0], cell[0] + 1, cell[1], cell[1] + 1).grown(margin, self.everything)


class Window(NamedTuple):
    """A part of a grid: rows ``[row_0, row_1)`` and columns ``[col_0, col_1)``."""

    row_0: int
    row_1: int
    col_0: int
    col_1: int

    def __bool__(self) -> bool:
        return self.row_0 < self.row_1 and self.col_0 < self.col_1

    @property
    def slices(self) -> tuple[slice, slice]:
        """The index of the window's cells in an array."""
        return slice(self.row_0, self.row_1), slice(self.col_0, self.col_1)

    def grown(self, margin: int, limits: "Window") -> "Window":
        """Returns the window grown by ``margin`` cells on each side, as far as it is within ``limits``."""
        row_0, row_1, col_0, col_1 = self
        return Window(row_0 - margin, row_1 + margin, col_0 - margin, col_1 + margin).within(limits)

    def within(self, other: "Window") -> "Window":
        """Returns the intersection of the two windows."""
        return Window(
            max(self.row_0, other.row_0),
            min(self.row_1, other.row_1),
            max(self.col_0, other.col_0),
            min(self.col_1, other.col_1),
        )

    def joined(self, other: "Window") -> "Window":
        """Returns the smallest window that contains both; empty windows are ignored."""
        if not other:
            return self
        if not self:
            return other
        return Window(
            min(self.row_0, other.row_0),
            max(self.row_1, other.row_1),
            min(self.col_0, other.col_0),
            max(self.col_1, other.col_1),
        )


EMPTY = Window(0, 0, 0, 0)
