"""A costmap: its layers merged, recomputed where something changed."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core import kernel
from nav_bundle.core.costmap.config import CostmapConfig, InflationConfig, StaticConfig
from nav_bundle.core.costmap.cost import FREE, LETHAL, UNKNOWN, cells_of_distance
from nav_bundle.core.costmap.layer import (
    EMPTY,
    Cells,
    Geometry,
    InflationLayer,
    Observation,
    ObstacleLayer,
    StaticLayer,
    Window,
)
from nav_bundle.core.grid import Grid
from nav_bundle.core.pose import Pose

_KNOWN = 0.3


class Costmap:
    """Costs around a robot, either fixed in a map's frame or rolling with the robot.

    Not thread-safe: one owner updates and reads it. The yaw of a map's origin is not supported,
    as in costmap_2d.

    Attributes:
        config: what it was made from.
        footprint: the robot's padded outline.
        geometry: where the cells lie.
        cells: uint8, shape (rows, cols), C-contiguous.
    """

    def __init__(self, config: CostmapConfig) -> None:
        self.config = config
        self.footprint = config.outline()
        self._static = [StaticLayer(layer) for layer in config.layers if isinstance(layer, StaticConfig)][:1]
        self._obstacles: list[ObstacleLayer] = []
        self._layers: list[StaticLayer | ObstacleLayer | InflationLayer] = []
        rows = cells_of_distance(config.height, config.resolution)
        cols = cells_of_distance(config.width, config.resolution)
        self._resize(Geometry(config.origin_x, config.origin_y, config.resolution, rows, cols))

    @property
    def ready(self) -> bool:
        """True once a static layer has its map."""
        return all(layer.cells is not None for layer in self._static)

    def set_map(self, grid: Grid) -> None:
        """Takes the static map, and its size and resolution with it; obstacles are forgotten."""
        for layer in self._static:
            layer.set_map(grid)
            self._resize(Geometry(grid.origin.x, grid.origin.y, grid.resolution, grid.rows, grid.cols))

    def _resize(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self._default = UNKNOWN if self.config.track_unknown_space else FREE
        self.cells: Cells = np.full((geometry.rows, geometry.cols), self._default, np.uint8)
        self._layers = [self._layer(layer) for layer in self.config.layers if layer.enabled]
        self._obstacles = [layer for layer in self._layers if isinstance(layer, ObstacleLayer)]
        self._margin = max([layer.radius for layer in self._layers if isinstance(layer, InflationLayer)], default=0)
        self._pending = self._everything()

    def _layer(self, config: object) -> "StaticLayer | ObstacleLayer | InflationLayer":
        if isinstance(config, StaticConfig):
            return self._static[0]
        if isinstance(config, InflationConfig):
            return InflationLayer(config, self.footprint, self.geometry.resolution)
        layer = ObstacleLayer(config)  # type: ignore[arg-type]
        layer.resize(self.geometry.rows, self.geometry.cols)
        return layer

    def _everything(self) -> Window:
        return Window(0, self.geometry.rows, 0, self.geometry.cols)

    def update(self, pose: Pose, observations: Sequence[Observation]) -> Window:
        """Brings the costs up to date; returns the window of cells that may differ from before.

        Args:
            pose: the robot's, in the costmap's frame; a rolling window is centred on it.
            observations: the newest of each source, in the costmap's frame.
        """
        changed, self._pending = self._pending, EMPTY
        if self.config.rolling_window and self._centre(pose):
            changed = self._everything()
        outline = self.footprint.outline(pose)
        for layer in self._obstacles:
            changed = changed.joined(layer.observe(self.geometry, observations, outline))
        if changed:
            changed = changed.grown(self._margin, self.geometry.rows, self.geometry.cols)
            self.cells[changed.row_0 : changed.row_1, changed.col_0 : changed.col_1] = self._default
            for merged in self._layers:
                merged.merge(self.cells, changed)
        return changed

    def _centre(self, pose: Pose) -> bool:
        """Moves the window by whole cells so that the robot is in its middle; tells whether it moved."""
        place = self.geometry
        right = place.col_of(pose.x) - place.cols // 2
        down = place.row_of(pose.y) - place.rows // 2
        if right == 0 and down == 0:
            return False
        place.origin_x += right * place.resolution
        place.origin_y += down * place.resolution
        for layer in self._obstacles:
            layer.shift(down, right)
        return True

    def clear_outside(self, pose: Pose, side: float) -> None:
        """Forgets what sensors saw outside the square of ``side`` [m] around ``pose``; shows in the next update."""
        for layer in self._obstacles:
            layer.clear_outside(self.geometry, pose, side)
        self._pending = self._everything()

    def reset(self) -> None:
        """Forgets all that sensors saw; shows in the next update."""
        for layer in self._obstacles:
            layer.resize(self.geometry.rows, self.geometry.cols)
        self._pending = self._everything()

    def footprint_cost(self, pose: Pose) -> int:
        """Returns the highest cost under the robot's outline at ``pose``: -1 lethal, -2 unknown, -3 off the grid."""
        place = self.geometry
        return int(
            kernel.footprint_cost(
                self.cells,
                place.origin_x,
                place.origin_y,
                place.resolution,
                self.footprint.vertices,
                pose.x,
                pose.y,
                pose.yaw,
            )
        )

    def strangers(self, pose: Pose, reach: float) -> NDArray[np.float64]:
        """Returns what sensors marked that the map does not know: points (n, 2) [m] within ``reach`` [m] of ``pose``.

        Cells nearer than 0.3 m to one that is lethal in the map count as known. Without a map there are no strangers.
        """
        if not self._static or self._static[0].cells is None:
            return np.empty((0, 2))
        place, margin = self.geometry, cells_of_distance(reach, self.geometry.resolution)
        row, col = place.row_of(pose.y), place.col_of(pose.x)
        part = Window(row, row + 1, col, col + 1).grown(margin, place.rows, place.cols)
        if not part:
            return np.empty((0, 2))
        window = np.s_[part.row_0 : part.row_1, part.col_0 : part.col_1]
        seen = np.zeros((part.row_1 - part.row_0, part.col_1 - part.col_0), bool)
        for layer in self._obstacles:
            seen |= layer.cells[window] == LETHAL
        seen &= ~self._static[0].near(part, cells_of_distance(_KNOWN, place.resolution))
        cells = np.argwhere(seen)[:, ::-1] + (part.col_0 + 0.5, part.row_0 + 0.5)
        return np.ascontiguousarray(cells * place.resolution + (place.origin_x, place.origin_y))

    def snapshot(self) -> Cells:
        """Returns a copy of the cells that later updates leave alone."""
        return self.cells.copy()
