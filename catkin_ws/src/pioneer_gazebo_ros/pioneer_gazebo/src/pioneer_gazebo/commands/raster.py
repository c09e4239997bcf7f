"""Rasterises cross-sections of a world: the occupancy map of what a laser at one height can see."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pioneer_gazebo.world.section import EMPTY, Section

OCCUPIED, FREE, UNKNOWN = 0, 254, 205
"""Grey values of map_server's trinary maps."""

_TOUCH = 1e-6
"""Overlaps below this [m] do not count: a wall flush with a cell border does not fill the adjacent cell."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Extent:
    """A grid's lower left corner [m], cell side [m] and shape."""

    x: float
    y: float
    resolution: float
    rows: int
    cols: int

    @classmethod
    def around(
        cls, sections: Iterable[Section], resolution: float, margin: float
    ) -> "Extent | None":
        """Returns the smallest grid with ``margin`` [m] around all sections; None if all are empty.

        The corner is an integer multiple of ``resolution``.
        """
        points = Section.joined(sections).extremes()
        if not len(points):
            return None
        low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
        first = np.floor(low / resolution + _TOUCH).astype(int)
        last = np.ceil(high / resolution - _TOUCH).astype(int)
        cols, rows = (int(n) for n in last - first)
        return cls(
            round(float(first[0] * resolution), 9),
            round(float(first[1] * resolution), 9),
            resolution,
            rows,
            cols,
        )


def occupied_cells(sections: Iterable[Section], extent: Extent) -> Mask:
    """Returns which cells a solid overlaps, shape (rows, cols), row 0 at the smallest y.

    Each section is the outline of one solid; its interior is found by the even-odd rule.
    """
    grid = np.zeros((extent.rows, extent.cols), dtype=np.bool_)
    for section in sections:
        _fill_outline(section.segments, extent, grid)
        for segment in section.segments:
            _draw_segment(segment, extent, grid)
        for circle in section.circles:
            _draw_disc(circle, extent, grid)
    return grid


def _window(
    extent: Extent, low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[slice, slice, NDArray[np.float64], NDArray[np.float64]]:
    """Returns the rows and columns of the cells in a rectangle, and their centres' x (1, n) and y (m, 1) [m]."""
    corner = (extent.x, extent.y)
    first = np.floor((low - corner) / extent.resolution + _TOUCH).astype(int)
    last = np.maximum(np.ceil((high - corner) / extent.resolution - _TOUCH).astype(int), first + 1)
    col, row = (int(n) for n in np.maximum(first, 0))
    col_end, row_end = (int(n) for n in np.clip(last, 0, (extent.cols, extent.rows)))
    x = extent.x + (np.arange(col, col_end) + 0.5) * extent.resolution
    y = extent.y + (np.arange(row, row_end) + 0.5) * extent.resolution
    return slice(row, row_end), slice(col, col_end), x[None, :], y[:, None]


def _draw_segment(segment: NDArray[np.float64], extent: Extent, grid: Mask) -> None:
    """Marks every cell whose interior the segment passes through (separating axis test of segment and square)."""
    start, along = segment[:2], segment[2:]
    end = start + along
    low, high = np.minimum(start, end), np.maximum(start, end)
    rows, cols, x, y = _window(extent, low, high)
    half = extent.resolution / 2 - _TOUCH
    reach = half * (abs(along[0]) + abs(along[1]))
    beside = np.abs(along[0] * (y - start[1]) - along[1] * (x - start[0])) <= reach
    within = (x > low[0] - half) & (x < high[0] + half) & (y > low[1] - half) & (y < high[1] + half)
    grid[rows, cols] |= beside & within


def _draw_disc(circle: NDArray[np.float64], extent: Extent, grid: Mask) -> None:
    """Marks every cell that the disc overlaps."""
    centre, radius = circle[:2], circle[2]
    rows, cols, x, y = _window(extent, centre - radius, centre + radius)
    half = extent.resolution / 2
    dx = np.maximum(np.abs(x - centre[0]) - half, 0.0)
    dy = np.maximum(np.abs(y - centre[1]) - half, 0.0)
    grid[rows, cols] |= dx * dx + dy * dy < (radius - _TOUCH) ** 2


def _fill_outline(segments: NDArray[np.float64], extent: Extent, grid: Mask) -> None:
    """Marks every cell whose centre lies inside the closed outline."""
    if not len(segments):
        return
    ends = Section(segments, EMPTY.circles).extremes()
    rows, cols, x, y = _window(extent, ends.min(axis=0), ends.max(axis=0))
    left, heights = extent.x + (cols.start + 0.5) * extent.resolution, y[:, 0]
    flips = np.zeros((len(heights), x.shape[1] + 1), dtype=np.int64)
    for ax, ay, dx, dy in segments:
        crossed = np.flatnonzero((ay <= heights) != (ay + dy <= heights))
        if len(crossed):
            crossing = ax + (heights[crossed] - ay) * (dx / dy)
            first = np.ceil((crossing - left) / extent.resolution).astype(int)
            np.add.at(flips, (crossed, np.clip(first, 0, x.shape[1])), 1)
    grid[rows, cols] |= np.cumsum(flips, axis=1)[:, :-1] % 2 == 1


def grey_map(occupied: Mask, outside_unknown: bool = True) -> NDArray[np.uint8]:
    """Returns the grey values of a map, shape (rows, cols), row 0 at the smallest y.

    Args:
        occupied: from `occupied_cells`.
        outside_unknown: whether free cells connected to the grid's border become unknown. If the world encloses no
            area, they stay free.
    """
    free = ~occupied
    grey = np.where(free, FREE, OCCUPIED).astype(np.uint8)
    if not outside_unknown:
        return grey
    labels, count = ndimage.label(free)
    border = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    is_outside = np.zeros(count + 1, dtype=np.bool_)
    is_outside[border[border > 0]] = True
    if not is_outside[1:].all():
        grey[is_outside[labels]] = UNKNOWN
    return grey
