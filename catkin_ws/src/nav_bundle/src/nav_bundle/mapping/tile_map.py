"""Maps of many particles that share common tiles (copy on write).

Cells are grouped into tiles, and all tiles are in one pool; a map is a directory of tile numbers. Copying a map copies
only its directory; a shared tile is copied when a map writes into it. Thirty maps that differ in the last few scans
thus need little more memory than one. A directory grows wherever beams reach, regardless of the published extent.
"""

import math

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.mapping import slam_kernel as kernel
from nav_bundle.mapping.slam_kernel import TILE
from nav_bundle.maps.grid import UNKNOWN, Grid

_MARGIN = 4
"""Extra tiles added when a directory grows, so that it grows rarely."""
_WIDEST = 2048
"""Largest extent of a directory along one axis [tiles]: 3.3 km at 0.05 m."""
_MOST_CELLS = 4.0e8
"""Largest number of cells of a map, which is published as a whole: 1 km by 1 km at 0.05 m."""
_FARTHEST = 1 << 23
"""Largest number of a tile, so that the kernels' 32 bits hold the numbers of its cells: 13,000 km at 0.05 m."""
_DRAWN = 20_000
"""Largest extent of a drawn map along one axis [cells] for which the map is extended to its configured size."""
_FIRST = 512
"""Initial number of tiles in a pool."""


class TileMaps:
    """The maps of ``count`` particles.

    Args:
        count: number of maps.
        x: x of the corner of cell (0, 0) [m]; cells with negative rows and columns exist, too.
        y: y of that corner [m].
        delta: cell size [m].
    """

    def __init__(self, count: int, x: float, y: float, delta: float) -> None:
        self._corner, self._delta = (x, y), delta
        #: tile numbers, int32, shape (count, tile rows, tile columns)
        self.directories = np.empty((count, 0, 0), np.int32)
        self._first = (
            0,
            0,
        )  # tile row and column of the directories' first tile, counted from cell (0, 0)
        self.pool = np.zeros(
            (_FIRST, TILE * TILE, 4), np.uint16
        )  #: the tiles, in the format of slam_kernel.py
        self._users = np.zeros(_FIRST, np.int32)
        self._spare = self._unused()

    @property
    def maps(self) -> kernel.Maps:
        """All maps, for matching."""
        return kernel.Maps(self.directories, self.pool, self._placement())

    def _placement(self) -> NDArray[np.float64]:
        row, col = self._first
        side = TILE * self._delta
        return np.array(
            [self._corner[0] + col * side, self._corner[1] + row * side, 1.0 / self._delta]
        )

    @property
    def tiles(self) -> int:
        """Number of tiles in use, 8 kB each."""
        return int(np.count_nonzero(self._users))

    def fits(self, poses: NDArray[np.float64], reach: float) -> bool:
        """Returns whether a scan at each of ``poses`` (n, 3) that reaches ``reach`` [m] fits into the largest map."""
        side = TILE * self._delta
        low = (poses[:, :2].min(axis=0) - reach - self._corner) / side
        high = (poses[:, :2].max(axis=0) + reach - self._corner) / side
        if self.directories.shape[1]:
            first = np.array(self._first[::-1])
            low = np.minimum(low, first)
            high = np.maximum(high, first + self.directories.shape[:0:-1])
        extent = high - low + 4 * _MARGIN
        widest = extent.max() < _WIDEST and np.prod(extent) * TILE**2 < _MOST_CELLS
        farthest = max(np.abs(low).max(), np.abs(high).max()) < _FARTHEST
        return bool(widest and farthest)

    def register(
        self,
        index: int,
        pose: NDArray[np.float64],
        beams: NDArray[np.float64],
        hits: NDArray[np.uint8],
    ) -> None:
        """Adds a scan to map ``index``.

        Args:
            index: index of the map.
            pose: the laser's x, y [m], yaw [rad], shape (3,).
            beams: cosine and sine of the bearing, length [cells], shape (m, 3).
            hits: 0 for beams that end in free space, shape (m,).
        """
        reach = float(beams[:, 2].max(initial=0.0)) * self._delta
        self._reserve(
            self._cover(pose[0] - reach, pose[1] - reach, pose[0] + reach, pose[1] + reach)
        )
        tiles = kernel.Tiles(self.pool, self._users, self._spare)
        kernel.register(pose, beams, hits, self._placement(), self.directories[index], tiles)

    def resample(self, chosen: NDArray[np.int64]) -> None:
        """Replaces the maps by those with the indices ``chosen``; indices may repeat."""
        self.directories = np.ascontiguousarray(self.directories[chosen])
        named = self.directories[self.directories >= 0]
        self._users[:] = np.bincount(named, minlength=len(self._users))
        self._spare = self._unused()

    def drawn(self, index: int, threshold: float, x: float, y: float) -> Grid:
        """Returns map ``index`` from its cell (0, 0) to (``x``, ``y``) [m], extended to all tiles in use.

        A visited cell is occupied if the share of hits among its visits exceeds ``threshold``, else free.
        """
        rows = math.ceil((y - self._corner[1]) / self._delta - 1e-9)
        cols = math.ceil((x - self._corner[0]) / self._delta - 1e-9)
        directory = np.ascontiguousarray(self.directories[index])
        (low, top), (left, right) = (
            self._extent(directory, axis, most) for axis, most in ((0, rows), (1, cols))
        )
        cells = np.full((top - low, right - left), UNKNOWN, np.int8)
        row, col = self._first[0] * TILE - low, self._first[1] * TILE - left
        kernel.draw(directory, self.pool, threshold, row, col, cells)
        return Grid(
            self._delta,
            Pose(self._corner[0] + left * self._delta, self._corner[1] + low * self._delta),
            cells,
        )

    def _extent(self, directory: NDArray[np.int32], axis: int, most: int) -> tuple[int, int]:
        """Returns the first and end row (axis 0) or column (axis 1) that contain 0 … ``most`` and all used tiles."""
        used = np.flatnonzero((directory >= 0).any(axis=1 - axis))
        if len(used) == 0:
            return 0, most
        first = int(self._first[axis] + used[0]) * TILE
        end = int(self._first[axis] + used[-1] + 1) * TILE
        if max(most, end) - min(0, first) > max(_DRAWN, most):
            return first, end  # far from the configured map, as with odometry in a map projection
        return min(0, first), max(most, end)

    def _cover(self, left: float, low: float, right: float, top: float) -> int:
        """Grows the directories to contain a box [m]; returns the number of tiles in the box."""
        side = TILE * self._delta
        x, y = self._corner
        # One extra tile on each side: rounding may move the end of a beam across a tile border.
        first = np.floor([(low - y) / side, (left - x) / side]).astype(int) - 1
        end = np.floor([(top - y) / side, (right - x) / side]).astype(int) + 2
        if self.directories.shape[1] == 0:
            self._first = (int(first[0]), int(first[1]))
        begin = np.array(self._first)
        before = np.maximum(0, begin - first)
        after = np.maximum(0, end - begin - self.directories.shape[1:])
        if before.any() or after.any():
            before, after = before + _MARGIN * (before > 0), after + _MARGIN * (after > 0)
            widths = [(0, 0), *zip(before.tolist(), after.tolist(), strict=True)]
            self.directories = np.pad(self.directories, widths, constant_values=-1)
            self._first = (int(begin[0] - before[0]), int(begin[1] - before[1]))
        return int(np.prod(end - first))

    def _reserve(self, tiles: int) -> None:
        """Grows the pool to at least ``tiles`` unused tiles."""
        if self._spare[0] >= tiles:
            return
        size = len(self._users) + max(tiles, len(self._users) // 4)
        # Resize in place: a copy of the pool would set the peak memory use.
        self.pool.resize((size, TILE * TILE, 4), refcheck=False)
        self._users = np.concatenate([self._users, np.zeros(size - len(self._users), np.int32)])
        self._spare = self._unused()

    def _unused(self) -> NDArray[np.int32]:
        """Returns the number of unused tiles, then the tiles in descending order, so that the lowest is taken first."""
        unused = np.flatnonzero(self._users == 0)[::-1]
        spare = np.empty(len(self._users) + 1, np.int32)
        spare[0] = len(unused)
        spare[1 : len(unused) + 1] = unused
        return spare
