"""The layers that a costmap is merged from."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core import kernel
from nav_bundle.core.costmap.config import InflationConfig, ObstacleConfig, SourceConfig, StaticConfig
from nav_bundle.core.costmap.cost import (
    FREE,
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    cells_of_distance,
    cost_by_occupancy,
    cost_by_squared_distance,
)
from nav_bundle.core.costmap.footprint import Footprint
from nav_bundle.core.grid import Grid
from nav_bundle.core.pose import Pose

Cells = NDArray[np.uint8]


@dataclass
class Geometry:
    """Where a costmap lies: corner of cell (0, 0) [m] in its frame, cell size [m], numbers of cells."""

    origin_x: float
    origin_y: float
    resolution: float
    rows: int
    cols: int

    def row_of(self, y: float) -> int:
        """Returns the row that holds ``y`` [m], inside or not."""
        return int(np.floor((y - self.origin_y) / self.resolution))

    def col_of(self, x: float) -> int:
        """Returns the column that holds ``x`` [m], inside or not."""
        return int(np.floor((x - self.origin_x) / self.resolution))


@dataclass(frozen=True)
class Window:
    """A part of a grid: rows ``[row_0, row_1)`` and columns ``[col_0, col_1)``."""

    row_0: int
    row_1: int
    col_0: int
    col_1: int

    def __bool__(self) -> bool:
        return self.row_0 < self.row_1 and self.col_0 < self.col_1

    def grown(self, margin: int, rows: int, cols: int) -> "Window":
        """Returns the window widened by ``margin`` cells on each side, within ``rows`` and ``cols``."""
        return Window(
            max(self.row_0 - margin, 0),
            min(self.row_1 + margin, rows),
            max(self.col_0 - margin, 0),
            min(self.col_1 + margin, cols),
        )

    def joined(self, other: "Window") -> "Window":
        """Returns the smallest window that holds both; an empty one adds nothing."""
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


@dataclass(frozen=True, eq=False)
class Observation:
    """What one laser saw: points (n, 2) [m] and the sensor's place [m], all in the costmap's frame."""

    source: SourceConfig
    sensor_x: float
    sensor_y: float
    points: NDArray[np.float64] = field(repr=False)


class StaticLayer:
    """The map, as costs."""

    def __init__(self, config: StaticConfig) -> None:
        self.config = config
        self.cells: Cells | None = None
        self._costs = cost_by_occupancy(
            config.lethal_cost_threshold,
            config.trinary_costmap,
            config.track_unknown_space,
            config.unknown_cost_value,
        )

    def set_map(self, grid: Grid) -> None:
        """Takes the map's cells; its geometry is the costmap's business."""
        self.cells = self._costs[grid.cells.view(np.uint8)]

    def near(self, window: Window, radius: int) -> NDArray[np.bool_]:
        """Tells for each cell of the window whether the map is lethal within ``radius`` cells of it, in the window."""
        assert self.cells is not None
        part = self.cells[window.row_0 : window.row_1, window.col_0 : window.col_1].copy()
        reached = np.full(radius * radius + 1, INSCRIBED, np.uint8)
        kernel.inflate(part, 0, part.shape[0], 0, part.shape[1], radius, reached, True)
        return (part == INSCRIBED) | (part == LETHAL)

    def merge(self, master: Cells, window: Window) -> None:
        """Writes the map into the window of ``master``."""
        if self.cells is None:
            return
        part = np.s_[window.row_0 : window.row_1, window.col_0 : window.col_1]
        if self.config.use_maximum:
            kernel.merge_highest(master, self.cells, window.row_0, window.row_1, window.col_0, window.col_1)
        else:
            master[part] = self.cells[part]


class ObstacleLayer:
    """What the lasers have seen: their returns mark, the way to them clears."""

    def __init__(self, config: ObstacleConfig) -> None:
        self.config = config
        self._default = UNKNOWN if config.track_unknown_space else FREE
        self.cells: Cells = np.full((1, 1), self._default, np.uint8)

    def resize(self, rows: int, cols: int) -> None:
        """Forgets everything and takes a new size."""
        self.cells = np.full((rows, cols), self._default, np.uint8)

    def shift(self, down: int, right: int) -> None:
        """Moves the grid's origin by cells; what leaves is forgotten, what enters is not known yet."""
        rows, cols = self.cells.shape
        moved = np.full_like(self.cells, self._default)
        if abs(down) < rows and abs(right) < cols:
            target = np.s_[max(-down, 0) : rows - max(down, 0), max(-right, 0) : cols - max(right, 0)]
            source = np.s_[max(down, 0) : rows - max(-down, 0), max(right, 0) : cols - max(-right, 0)]
            moved[target] = self.cells[source]
        self.cells = moved

    def observe(self, geometry: Geometry, observations: Iterable[Observation], outline: NDArray[np.float64]) -> Window:
        """Clears and marks; returns the window of the cells that differ from before."""
        mine = [seen for seen in observations if seen.source in self.config.sources]
        touched = self._reach(geometry, mine, outline)
        if not touched:
            return EMPTY
        before = self.cells[touched.row_0 : touched.row_1, touched.col_0 : touched.col_1].copy()
        place = (geometry.origin_x, geometry.origin_y, geometry.resolution)
        for seen in mine:
            if seen.source.clearing:
                sensor = (seen.sensor_x, seen.sensor_y)
                kernel.clear_rays(self.cells, *place, *sensor, seen.points, seen.source.raytrace_range)
        for seen in mine:
            if seen.source.marking:
                sensor = (seen.sensor_x, seen.sensor_y)
                kernel.mark_points(self.cells, *place, *sensor, seen.points, seen.source.obstacle_range)
        if self.config.footprint_clearing_enabled:
            kernel.fill_polygon(self.cells, *place, outline, FREE)
        changed = np.array([geometry.rows, 0, geometry.cols, 0], np.int64)
        kernel.changed_window(self.cells, before, touched.row_0, touched.col_0, changed)
        window = Window(*(int(edge) for edge in changed))
        return window if window else EMPTY

    def _reach(self, geometry: Geometry, seen: list[Observation], outline: NDArray[np.float64]) -> Window:
        """Returns the window outside which nothing can change."""
        (x_0, y_0), (x_1, y_1) = outline.min(axis=0), outline.max(axis=0)
        for each in seen:
            reach = max(each.source.raytrace_range, each.source.obstacle_range)
            x_0, x_1 = min(x_0, each.sensor_x - reach), max(x_1, each.sensor_x + reach)
            y_0, y_1 = min(y_0, each.sensor_y - reach), max(y_1, each.sensor_y + reach)
        return Window(
            max(geometry.row_of(y_0), 0),
            min(geometry.row_of(y_1) + 1, geometry.rows),
            max(geometry.col_of(x_0), 0),
            min(geometry.col_of(x_1) + 1, geometry.cols),
        )

    def clear_outside(self, geometry: Geometry, pose: Pose, side: float) -> None:
        """Forgets everything outside the square of ``side`` [m] around ``pose``."""
        half = side / 2.0
        rows = slice(max(geometry.row_of(pose.y - half), 0), max(geometry.row_of(pose.y + half), 0))
        cols = slice(max(geometry.col_of(pose.x - half), 0), max(geometry.col_of(pose.x + half), 0))
        kept = self.cells[rows, cols].copy()
        self.cells[:, :] = self._default
        self.cells[rows, cols] = kept

    def merge(self, master: Cells, window: Window) -> None:
        """Merges the layer into the window of ``master``."""
        merged = kernel.merge_highest if self.config.combination_method == 1 else kernel.merge_known
        merged(master, self.cells, window.row_0, window.row_1, window.col_0, window.col_1)


class InflationLayer:
    """Costs that fall with the distance to the nearest lethal cell."""

    def __init__(self, config: InflationConfig, footprint: Footprint, resolution: float) -> None:
        self.config = config
        self.radius = cells_of_distance(config.inflation_radius, resolution)
        self._table = cost_by_squared_distance(
            self.radius, resolution, footprint.inscribed_radius, config.cost_scaling_factor
        )

    def merge(self, master: Cells, window: Window) -> None:
        """Inflates into the window of ``master``; lethal cells around the window count too."""
        if self.radius > 0:
            place = (window.row_0, window.row_1, window.col_0, window.col_1)
            kernel.inflate(master, *place, self.radius, self._table, self.config.inflate_unknown)
