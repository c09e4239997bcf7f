"""Costmap layers: static map, obstacles, inflation."""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.costmap import costmap_kernel as kernel
from nav_bundle.costmap.config import (
    InflationConfig,
    ObstacleConfig,
    SourceConfig,
    StaticConfig,
)
from nav_bundle.costmap.cost import (
    FREE,
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    cells_of_distance,
    cost_by_occupancy,
    cost_by_squared_distance,
)
from nav_bundle.costmap.footprint import Footprint
from nav_bundle.costmap.geometry import EMPTY, Cells, Geometry, Window
from nav_bundle.maps.grid import Grid

_ROWS_AT_ONCE = 256  # bounds the temporary memory for large maps


@dataclass(frozen=True, eq=False)
class Observation:
    """One sensor reading: points (n, 2) [m], sensor position [m] and yaw [rad], all in the costmap's frame.

    ``heights`` are the points' heights [m], shape (n,); None if they are not known, which counts as the sensor's.
    """

    source: SourceConfig
    sensor_x: float
    sensor_y: float
    points: NDArray[np.float64] = field(repr=False)
    sensor_yaw: float = 0.0
    sensor_z: float = 0.0
    heights: NDArray[np.float64] | None = field(default=None, repr=False)


class ObservationBuffer:
    """Observations in the costmap's frame, kept for ``persistence`` [s] after their stamp; 0 keeps only the newest."""

    def __init__(self, persistence: float) -> None:
        self.persistence = persistence
        self._kept: deque[tuple[float, Observation]] = deque()

    @property
    def newest(self) -> float:
        """Stamp [s] of the newest observation; minus infinity if there is none."""
        return self._kept[-1][0] if self._kept else float("-inf")

    @property
    def last(self) -> Observation | None:
        """The newest observation; None if there is none."""
        return self._kept[-1][1] if self._kept else None

    def add(self, stamp: float, observation: Observation) -> None:
        """Adds an observation, which must be newer than the earlier ones."""
        if self.persistence <= 0.0:
            self._kept.clear()
        self._kept.append((stamp, observation))

    def current(self, now: float) -> list[Observation]:
        """Returns the observations valid at ``now`` [s], oldest first; drops expired ones, but never the newest."""
        while len(self._kept) > 1 and self._kept[0][0] < now - self.persistence:
            self._kept.popleft()
        return [observation for _, observation in self._kept]

    def forget(self) -> None:
        """Drops all observations, for example after a clock jump."""
        self._kept.clear()


class StaticLayer:
    """The static map, converted to costs."""

    def __init__(self, config: StaticConfig) -> None:
        self.config = config
        #: the map's costs in the costmap's cells, unknown outside the map; None without a map
        self.cells: Cells | None = None
        self.place: Geometry | None = None  #: geometry of the map in its frame; None without a map
        self._map: Cells | None = None
        self._costs = cost_by_occupancy(
            config.lethal_cost_threshold,
            config.trinary_costmap,
            config.track_unknown_space,
            config.unknown_cost_value,
        )

    @property
    def takes_map(self) -> bool:
        """Whether another map replaces this one; with ``first_map_only`` only the first one counts."""
        return self.place is None or not self.config.first_map_only

    def set_map(self, grid: Grid) -> None:
        """Sets the map; resamples a rotated map into the smallest axis-aligned grid that contains it."""
        costs = self._costs[grid.cells.view(np.uint8)]
        self.place = Geometry(grid.origin.x, grid.origin.y, grid.resolution, grid.rows, grid.cols)
        if grid.origin.yaw != 0.0:
            self.place = _upright(grid)
            costs = _sampled(costs, grid.origin, grid.resolution, self.place)
        self.cells = self._map = costs

    def fit(self, geometry: Geometry) -> None:
        """Resamples the map into a costmap that does not roll and has the geometry of another map."""
        if self._map is None or self.place is None:
            return
        self.cells = self._map
        if self.place != geometry:
            self.cells = None
            self.lie(geometry, Pose())

    def lie(self, geometry: Geometry, here_from_map: Pose) -> bool:
        """Resamples the map into a rolling costmap; returns whether any cell changed.

        Args:
            geometry: geometry of the costmap.
            here_from_map: pose of the map's frame in the costmap's.
        """
        assert self._map is not None
        assert self.place is not None
        origin = here_from_map.compose(Pose(self.place.origin_x, self.place.origin_y))
        before, self.cells = (
            self.cells,
            _sampled(self._map, origin, self.place.resolution, geometry),
        )
        return before is None or not np.array_equal(before, self.cells)

    def near(self, window: Window, radius: int) -> NDArray[np.bool_]:
        """Returns a mask of the window's cells that have a lethal map cell of the window within ``radius`` cells."""
        assert self.cells is not None
        part = self.cells[window.slices].copy()
        reached = np.full(radius * radius + 1, INSCRIBED, np.uint8)
        kernel.inflate(part, (0, part.shape[0], 0, part.shape[1]), radius, reached, True)
        return (part == INSCRIBED) | (part == LETHAL)

    def merge(self, master: Cells, window: Window) -> None:
        """Writes the map into the window of ``master``; in a rolling costmap, only the map's known cells."""
        if self.cells is None:
            return
        if self.config.use_maximum:
            kernel.merge_highest(master, self.cells, window)
        elif self.cells is not self._map:
            kernel.merge_known(master, self.cells, window)
        else:
            master[window.slices] = self.cells[window.slices]


def _upright(grid: Grid) -> Geometry:
    """Returns the smallest axis-aligned grid that contains a rotated one."""
    resolution = grid.resolution
    corners = np.array(
        [
            grid.origin.apply(x * resolution, y * resolution)
            for x in (0, grid.cols)
            for y in (0, grid.rows)
        ]
    )
    (left, bottom), (right, top) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    size = cells_of_distance(top - bottom, resolution), cells_of_distance(right - left, resolution)
    return Geometry(left, bottom, resolution, *size)


def _sampled(cells: Cells, origin: Pose, resolution: float, place: Geometry) -> Cells:
    """Returns ``cells`` sampled at the centres of another grid's cells (nearest cell); unknown where they do not reach.

    Args:
        cells: uint8, shape (rows, cols).
        origin: pose of the corner of ``cells`` in the frame of ``place``.
        resolution: cell size of ``cells`` [m].
        place: geometry of the other grid.
    """
    found = np.full((place.rows, place.cols), UNKNOWN, np.uint8)
    cosine, sine = math.cos(origin.yaw), math.sin(origin.yaw)
    dx = place.origin_x + (np.arange(place.cols) + 0.5) * place.resolution - origin.x
    for first in range(0, len(found), _ROWS_AT_ONCE):
        part = found[first : first + _ROWS_AT_ONCE]
        rows = np.arange(first, first + len(part))
        dy = (place.origin_y + (rows + 0.5) * place.resolution - origin.y)[:, None]
        col = np.floor((cosine * dx + sine * dy) / resolution).astype(np.int64)
        row = np.floor((cosine * dy - sine * dx) / resolution).astype(np.int64)
        inside = (row >= 0) & (row < cells.shape[0]) & (col >= 0) & (col < cells.shape[1])
        part[inside] = cells[row[inside], col[inside]]
    return found


def shifted(grid: NDArray[Any], down: int, right: int, default: int) -> NDArray[Any]:
    """Returns ``grid``, shape (rows, cols), with its origin moved by cells; cells that enter are ``default``."""
    rows, cols = grid.shape
    moved = np.full_like(grid, default)
    if abs(down) < rows and abs(right) < cols:
        target = np.s_[max(-down, 0) : rows - max(down, 0), max(-right, 0) : cols - max(right, 0)]
        source = np.s_[max(down, 0) : rows - max(-down, 0), max(right, 0) : cols - max(-right, 0)]
        moved[target] = grid[source]
    return moved


class ObstacleLayer:
    """Sensor obstacles: returns mark cells, the rays to them clear cells.

    Unlike in costmap_2d, a ray that ends on an obstacle does not clear the obstacle's cell: beyond ``obstacle_range``
    it would not be marked again, so that a robot would forget what it still sees.
    """

    def __init__(self, config: ObstacleConfig, rows: int, cols: int) -> None:
        self.config = config
        self._default = UNKNOWN if config.track_unknown_space else FREE
        self.cells: Cells = np.full((rows, cols), self._default, np.uint8)

    def succeed(self, predecessor: "ObstacleLayer") -> None:
        """Takes over the obstacles of the layer that this one replaces."""
        self.cells = predecessor.cells

    def clear(self) -> None:
        """Clears all cells."""
        self.cells.fill(self._default)

    def shift(self, down: int, right: int) -> None:
        """Shifts the grid's origin by cells; drops cells that leave the grid and resets those that enter."""
        self.cells = shifted(self.cells, down, right, self._default)

    def observe(
        self, geometry: Geometry, observations: Iterable[Observation], outline: NDArray[np.float64]
    ) -> Window:
        """Clears and marks cells; returns the window of the cells that changed."""
        mine = [seen for seen in observations if seen.source in self.config.sources]
        touched = self.reach(geometry, mine, outline)
        if not touched:
            return EMPTY
        before = self.cells[touched.slices].copy()
        place = geometry.place
        for seen in mine:
            if seen.source.clearing:
                rays = kernel.Rays(
                    seen.sensor_x, seen.sensor_y, seen.points, seen.source.raytrace_range
                )
                kernel.clear_rays(self.cells, place, rays)
        for seen in mine:
            # What a sensor still sees beyond its obstacle range is not forgotten.
            if seen.source.clearing and seen.source.marking:
                rays = kernel.Rays(
                    seen.sensor_x, seen.sensor_y, seen.points, seen.source.raytrace_range
                )
                kernel.keep_points(self.cells, before, touched.row_0, touched.col_0, place, rays)
        for seen in mine:
            if seen.source.marking:
                rays = kernel.Rays(
                    seen.sensor_x, seen.sensor_y, seen.points, seen.source.obstacle_range
                )
                kernel.mark_points(self.cells, place, rays)
        if self.config.footprint_clearing_enabled:
            kernel.fill_polygon(self.cells, place, outline, FREE)
        changed = np.array([geometry.rows, 0, geometry.cols, 0], np.int64)
        kernel.changed_window(self.cells, before, touched.row_0, touched.col_0, changed)
        return Window(*changed.tolist())

    def reach(
        self, geometry: Geometry, seen: list[Observation], outline: NDArray[np.float64]
    ) -> Window:
        """Returns the window that contains all cells that can change."""
        (x_0, y_0), (x_1, y_1) = outline.min(axis=0), outline.max(axis=0)
        for each in seen:
            reach = max(each.source.raytrace_range, each.source.obstacle_range)
            x_0, x_1 = min(x_0, each.sensor_x - reach), max(x_1, each.sensor_x + reach)
            y_0, y_1 = min(y_0, each.sensor_y - reach), max(y_1, each.sensor_y + reach)
        return geometry.window_between(x_0, y_0, x_1, y_1)

    def clear_inside(self, geometry: Geometry, pose: Pose, side: float) -> None:
        """Clears all cells inside the square of ``side`` [m] around ``pose``."""
        self.cells[square_around(geometry, pose, side)] = self._default

    def clear_outside(self, geometry: Geometry, pose: Pose, side: float) -> None:
        """Clears all cells outside the square of ``side`` [m] around ``pose``."""
        rows, cols = square_around(geometry, pose, side)
        kept = self.cells[rows, cols].copy()
        self.cells.fill(self._default)
        self.cells[rows, cols] = kept

    def merge(self, master: Cells, window: Window) -> None:
        """Merges the layer into the window of ``master``."""
        merge = kernel.merge_highest if self.config.combination_method == 1 else kernel.merge_known
        merge(master, self.cells, window)


def square_around(geometry: Geometry, pose: Pose, side: float) -> tuple[slice, slice]:
    """Returns the rows and columns of the square of ``side`` [m] around ``pose``."""
    half = side / 2.0
    rows = slice(max(geometry.row_of(pose.y - half), 0), max(geometry.row_of(pose.y + half), 0))
    cols = slice(max(geometry.col_of(pose.x - half), 0), max(geometry.col_of(pose.x + half), 0))
    return rows, cols


class InflationLayer:
    """Adds costs that decay with the distance to the nearest lethal cell."""

    def __init__(self, config: InflationConfig, footprint: Footprint, resolution: float) -> None:
        self.config = config
        self.radius = cells_of_distance(config.inflation_radius, resolution)
        self._resolution = resolution
        self._table = cost_by_squared_distance(
            self.radius, resolution, footprint.inscribed_radius, config.cost_scaling_factor
        )

    def cost_at(self, distance: float) -> int:
        """Returns the cost of a cell at ``distance`` [m] from the nearest lethal cell."""
        squared = int((distance / self._resolution) ** 2)
        return int(self._table[squared]) if squared < len(self._table) else 0

    def merge(self, master: Cells, window: Window) -> None:
        """Inflates obstacles into the window of ``master``, including lethal cells outside the window."""
        if self.radius > 0:
            kernel.inflate(master, window, self.radius, self._table, self.config.inflate_unknown)
