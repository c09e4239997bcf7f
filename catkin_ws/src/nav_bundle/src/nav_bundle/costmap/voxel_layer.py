"""A costmap layer whose cells are columns of voxels: what a sensor sees at one height is not cleared at another."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.costmap import costmap_kernel as kernel
from nav_bundle.costmap.config import VoxelConfig
from nav_bundle.costmap.cost import FREE, LETHAL, UNKNOWN
from nav_bundle.costmap.geometry import EMPTY, Geometry, Window
from nav_bundle.costmap.layer import Observation, ObstacleLayer, shifted, square_around

Columns = NDArray[np.uint16]
"""One bit for each voxel of a column, the lowest first; shape (rows, cols)."""

_BITS = np.array([value.bit_count() for value in range(1 << 16)], np.uint8)
"""Number of bits set, by value of a column."""
_RAYS = 1000
"""Number of rays followed at the same time: what they need grows with their number times the longest one's steps."""
_UNDER_FOOTPRINT = 1
"""Stands in the cells, for a moment, for those under the robot; no cost of this layer has this value."""


class VoxelLayer(ObstacleLayer):
    """Sensor obstacles in columns of voxels: returns mark voxels, the rays to them clear voxels.

    As in ``ObstacleLayer``, a ray that ends on an obstacle does not clear its voxel. Rays from a sensor above or below
    the columns clear what they cross of them, whereas costmap_2d ignores such a sensor.
    """

    def __init__(self, config: VoxelConfig, rows: int, cols: int) -> None:
        super().__init__(config, rows, cols)
        self._voxels = config
        self._all = (1 << config.z_voxels) - 1
        self.marked: Columns = np.zeros((rows, cols), np.uint16)  #: voxels with an obstacle
        self.unknown: Columns = np.full((rows, cols), self._all, np.uint16)  #: never seen

    def succeed(self, predecessor: ObstacleLayer) -> None:
        """Takes over the obstacles of the layer that this one replaces, if its columns are alike."""
        if not isinstance(predecessor, VoxelLayer) or predecessor.column != self.column:
            return
        super().succeed(predecessor)
        self.marked, self.unknown = predecessor.marked, predecessor.unknown

    @property
    def column(self) -> tuple[float, float, int]:
        """Lowest height [m], height of a voxel [m] and number of voxels."""
        return self._voxels.origin_z, self._voxels.z_resolution, self._voxels.z_voxels

    def clear(self) -> None:
        """Clears all cells."""
        super().clear()
        self.marked.fill(0)
        self.unknown.fill(self._all)

    def shift(self, down: int, right: int) -> None:
        """Shifts the grid's origin by cells; drops columns that leave the grid and resets those that enter."""
        super().shift(down, right)
        self.marked = shifted(self.marked, down, right, 0)
        self.unknown = shifted(self.unknown, down, right, self._all)

    def clear_inside(self, geometry: Geometry, pose: Pose, side: float) -> None:
        """Clears all cells inside the square of ``side`` [m] around ``pose``."""
        super().clear_inside(geometry, pose, side)
        inside = square_around(geometry, pose, side)
        self.marked[inside] = 0
        self.unknown[inside] = self._all

    def clear_outside(self, geometry: Geometry, pose: Pose, side: float) -> None:
        """Clears all cells outside the square of ``side`` [m] around ``pose``."""
        super().clear_outside(geometry, pose, side)
        inside = square_around(geometry, pose, side)
        marked, unknown = self.marked[inside].copy(), self.unknown[inside].copy()
        self.marked.fill(0)
        self.unknown.fill(self._all)
        self.marked[inside], self.unknown[inside] = marked, unknown

    def observe(
        self, geometry: Geometry, observations: Iterable[Observation], outline: NDArray[np.float64]
    ) -> Window:
        """Clears and marks voxels; returns the window of the cells that changed."""
        mine = [seen for seen in observations if seen.source in self.config.sources]
        touched = self.reach(geometry, mine, outline)
        if not touched:
            return EMPTY
        before = self.cells[touched.slices].copy()
        crossed: Columns = np.zeros_like(self.marked)
        hit: Columns = np.zeros_like(self.marked)
        for seen in mine:
            ends = self._ends(geometry, seen)
            if seen.source.clearing:
                self._note_rays(crossed, geometry, seen, ends)
                kept: Columns = np.zeros_like(self.marked)
                self._note(kept, np.floor(ends).astype(np.int64))
                # What a sensor still sees beyond its obstacle range is not forgotten.
                crossed &= ~(kept & self.marked) if seen.source.marking else ~np.uint16(0)
        for seen in mine:
            if seen.source.marking:
                ends = self._ends(geometry, seen)
                # As in costmap_2d, what is below the lowest voxel counts for it.
                ends[:, 2] = np.maximum(ends[:, 2], 0.0)
                away = np.hypot(
                    seen.points[:, 0] - seen.sensor_x, seen.points[:, 1] - seen.sensor_y
                )
                near = away < seen.source.obstacle_range
                self._note(hit, np.floor(ends[near]).astype(np.int64))
        self._take(crossed, hit)
        if self.config.footprint_clearing_enabled:
            self._clear_under(geometry, outline, touched)
        changed = np.array([geometry.rows, 0, geometry.cols, 0], np.int64)
        kernel.changed_window(self.cells, before, touched.row_0, touched.col_0, changed)
        return Window(*changed.tolist())

    def _take(self, crossed: Columns, hit: Columns) -> None:
        """Clears the crossed voxels, marks those that were hit, and sets the costs of their columns."""
        seen = (crossed | hit) != 0
        self.marked &= ~crossed
        self.marked |= hit
        self.unknown &= ~(crossed | hit)
        marked, unknown = self.marked[seen], self.unknown[seen]
        costs = np.full(len(marked), FREE, np.uint8)
        costs[_BITS[unknown] > self._voxels.unknown_threshold] = UNKNOWN
        costs[_BITS[marked] > self._voxels.mark_threshold] = LETHAL
        self.cells[seen] = costs

    def _clear_under(
        self, geometry: Geometry, outline: NDArray[np.float64], touched: Window
    ) -> None:
        """Clears the columns under the robot."""
        kernel.fill_polygon(self.cells, geometry.place, outline, _UNDER_FOOTPRINT)
        under = self.cells[touched.slices] == _UNDER_FOOTPRINT
        self.cells[touched.slices][under] = FREE
        self.marked[touched.slices][under] = 0
        self.unknown[touched.slices][under] = 0

    def _scaled(self, geometry: Geometry, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns points (n, 3) [m] in units of voxels, as column, row and level."""
        origin = np.array([geometry.origin_x, geometry.origin_y, self._voxels.origin_z])
        size = np.array([geometry.resolution, geometry.resolution, self._voxels.z_resolution])
        return (points - origin) / size

    def _ends(self, geometry: Geometry, seen: Observation) -> NDArray[np.float64]:
        """Returns the observation's points in units of voxels, shape (n, 3)."""
        heights = seen.heights
        if heights is None:
            heights = np.full(len(seen.points), seen.sensor_z)
        return self._scaled(geometry, np.column_stack([seen.points, heights]))

    def _note_rays(
        self, crossed: Columns, geometry: Geometry, seen: Observation, ends: NDArray[np.float64]
    ) -> None:
        """Sets the bits of the voxels between the sensor and the points ``ends``, shape (n, 3)."""
        # Rays to the same voxel clear the same voxels.
        targets = np.unique(np.floor(ends), axis=0)
        for block in np.array_split(targets, 1 + len(targets) // _RAYS):
            self._note(crossed, self._along_rays(geometry, seen, block))

    def _along_rays(
        self, geometry: Geometry, seen: Observation, targets: NDArray[np.float64]
    ) -> NDArray[np.int64]:
        """Returns the voxels (column, row, level), shape (k, 3), from the sensor up to ``targets``, shape (n, 3)."""
        sensor = np.array([[seen.sensor_x, seen.sensor_y, seen.sensor_z]])
        start = self._scaled(geometry, sensor)[0]
        ways = targets + 0.5 - start
        length = np.hypot(ways[:, 0], ways[:, 1]) * geometry.resolution
        ways *= np.minimum(1.0, seen.source.raytrace_range / np.maximum(length, 1.0e-9))[:, None]
        steps = np.ceil(np.abs(ways).max(axis=1, initial=0.0)).astype(np.int64)
        # Axes: ray, step, coordinate.
        shares = np.arange(steps.max(initial=0))[None, :] / np.maximum(steps, 1)[:, None]
        along = start + ways[:, None, :] * shares[:, :, None]
        voxels = np.floor(along).astype(np.int64)
        own = (voxels == targets.astype(np.int64)[:, None, :]).all(axis=2)
        return voxels[(shares < 1.0) & ~own]

    def _note(self, columns: Columns, voxels: NDArray[np.int64]) -> None:
        """Sets the bits of those ``voxels`` (column, row, level), shape (n, 3), that are in the grid."""
        rows, cols = columns.shape
        col, row, level = voxels.T
        inside = (col >= 0) & (col < cols) & (row >= 0) & (row < rows)
        inside &= (level >= 0) & (level < self._voxels.z_voxels)
        bits = (1 << level[inside]).astype(np.uint16)
        np.bitwise_or.at(columns, (row[inside], col[inside]), bits)
