"""Occupancy grids: the map type of this package."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.error import MapError
from nav_bundle.base.pose import Pose

UNKNOWN = -1
"""A cell that has not been observed."""
FREE = 0
"""A cell that is certainly free."""
OCCUPIED = 100
"""A cell that is certainly occupied."""


@dataclass(frozen=True, eq=False)
class Grid:
    """A map of square cells. Cell (0, 0) is at the origin; rows increase with y, columns with x.

    Raises:
        MapError: the resolution is not positive, or the cells are not a non-empty 2D int8 array.
    """

    resolution: float  #: side of a cell [m], positive
    origin: Pose  #: pose of the outer corner of cell (0, 0) in the map frame; its yaw rotates the whole grid
    #: int8, shape (rows, cols): ``UNKNOWN`` (-1), or occupancy from 0 to 100, as in nav_msgs/OccupancyGrid
    cells: NDArray[np.int8] = field(repr=False)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.resolution) and self.resolution > 0.0):
            raise MapError(f"a map's resolution must be positive, not {self.resolution}")
        if self.cells.ndim != 2 or self.cells.dtype != np.int8 or self.cells.size == 0:
            raise MapError(
                f"a map needs int8 cells in rows and columns, not {self.cells.dtype}{self.cells.shape}"
            )

    @property
    def rows(self) -> int:
        """Number of rows: cells along y."""
        return int(self.cells.shape[0])

    @property
    def cols(self) -> int:
        """Number of columns: cells along x."""
        return int(self.cells.shape[1])

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """Returns (row, col) of the cell that contains point (``x``, ``y``) [m, map frame], inside the grid or not."""
        along, across = self.origin.inverse().apply(x, y)
        return math.floor(across / self.resolution), math.floor(along / self.resolution)

    def point_at(self, row: float, col: float) -> tuple[float, float]:
        """Returns the centre (x, y) [m, map frame] of cell (``row``, ``col``)."""
        return self.origin.apply((col + 0.5) * self.resolution, (row + 0.5) * self.resolution)

    def cells_at(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Returns (row, col), shape (n, 2), of the cells at ``points`` (x, y) [m, map frame], shape (n, 2)."""
        along, across = self.origin.inverse().apply(*points.T)
        return np.floor(np.stack([across, along], axis=1) / self.resolution).astype(np.int64)

    def points_at(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Returns the centres (x, y) [m, map frame], shape (n, 2), of ``cells`` (row, col), shape (n, 2)."""
        across, along = ((cells + 0.5) * self.resolution).T
        return np.stack(self.origin.apply(along, across), axis=1)
