"""Position and size of grids, and windows within them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nav_bundle.kernels.costmap import Place

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

    def row_of(self, y: float) -> int:
        """Returns the row that contains ``y`` [m], inside the grid or not."""
        return int(np.floor((y - self.origin_y) / self.resolution))

    def col_of(self, x: float) -> int:
        """Returns the column that contains ``x`` [m], inside the grid or not."""
        return int(np.floor((x - self.origin_x) / self.resolution))


class Window(NamedTuple):
    """A part of a grid: rows ``[row_0, row_1)`` and columns ``[col_0, col_1)``."""

    row_0: int
    row_1: int
    col_0: int
    col_1: int

    def __bool__(self) -> bool:
        return self.row_0 < self.row_1 and self.col_0 < self.col_1

    def grown(self, margin: int, rows: int, cols: int) -> "Window":
        """Returns the window grown by ``margin`` cells on each side, clipped to ``rows`` and ``cols``."""
        return Window(
            max(self.row_0 - margin, 0),
            min(self.row_1 + margin, rows),
            max(self.col_0 - margin, 0),
            min(self.col_1 + margin, cols),
        )

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
