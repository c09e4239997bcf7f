"""Costmap kernels: clearing, marking, merging of layers, and inflation by an exact distance transform.

Grids are ``[row, col]`` of unsigned bytes with costmap_2d's values: 0 free, 253 inscribed,
254 lethal, 255 unknown.
"""

from typing import NamedTuple

import numpy as np

from pioneer_kernels.declaration import Array1, Array2, kernel, njit

FREE = 0
INSCRIBED = 253
LETHAL = 254
UNKNOWN = 255

Costs = Array2[np.uint8]
Points = Array2[np.float64]
"""(x, y) [m], shape (n, 2)."""
Bounds = tuple[int, int, int, int]
"""A window of a grid: first row, row after the last, first column, column after the last."""


class Place(NamedTuple):
    """Origin and resolution of a grid: corner of cell (0, 0) [m] in its frame, cell size [m]."""

    x: float
    y: float
    resolution: float


class Rays(NamedTuple):
    """Points seen by a sensor at (x, y) [m], and the maximum distance [m] at which they count."""

    x: float
    y: float
    points: Points
    longest: float


@njit
def cell_at(place, x, y):
    """Returns the row and column of the cell that contains (x, y) [m]."""
    return int(np.floor((y - place.y) / place.resolution)), int(
        np.floor((x - place.x) / place.resolution)
    )


@njit
def line_between(row_0, col_0, row_1, col_1):
    """Returns Bresenham's line for ``next_cell``: steps in total, steps along each axis, directions."""
    d_row = abs(row_1 - row_0)
    d_col = abs(col_1 - col_0)
    return max(d_row, d_col), d_row, d_col, 1 if row_1 > row_0 else -1, 1 if col_1 > col_0 else -1


@njit
def next_cell(row, col, error_row, error_col, line):
    """Returns the line's next cell and the updated errors; initialise both errors with half of ``line[0]``."""
    length, d_row, d_col, step_row, step_col = line
    error_row -= d_row
    if error_row < 0:
        error_row += length
        row += step_row
    error_col -= d_col
    if error_col < 0:
        error_col += length
        col += step_col
    return row, col, error_row, error_col


@njit
def set_line(cells, row_0, col_0, row_1, col_1, value):
    """Writes ``value`` along Bresenham's line, both ends included, skipping cells outside the grid."""
    rows, cols = cells.shape
    line = line_between(row_0, col_0, row_1, col_1)
    row, col, error_row, error_col = row_0, col_0, line[0] // 2, line[0] // 2
    was_inside = False
    for _ in range(line[0] + 1):
        if 0 <= row < rows and 0 <= col < cols:
            cells[row, col] = value
            was_inside = True
        elif was_inside:
            return  # a straight line does not come back
        row, col, error_row, error_col = next_cell(row, col, error_row, error_col, line)


@kernel
def clear_rays(cells: Costs, place: Place, rays: Rays) -> None:
    """Clears the cells between the sensor and each point, up to ``rays.longest``."""
    rows, cols = cells.shape
    row_0, col_0 = cell_at(place, rays.x, rays.y)
    if row_0 < 0 or row_0 >= rows or col_0 < 0 or col_0 >= cols:
        return
    for i in range(rays.points.shape[0]):
        dx = rays.points[i, 0] - rays.x
        dy = rays.points[i, 1] - rays.y
        distance = np.sqrt(dx * dx + dy * dy)
        if distance > rays.longest:
            dx *= rays.longest / distance
            dy *= rays.longest / distance
        row_1, col_1 = cell_at(place, rays.x + dx, rays.y + dy)
        set_line(cells, row_0, col_0, row_1, col_1, FREE)


@kernel
def keep_points(
    cells: Costs, before: Costs, row_0: int, col_0: int, place: Place, rays: Rays
) -> None:
    """Restores the lethal cells in which a point lies: rays to other points, or its own, have cleared them.

    ``before`` is a copy of the part of ``cells`` that starts at ``row_0, col_0``. Points count up to a cell's diagonal
    beyond ``rays.longest``, since a ray that is cut off there may clear the cell of a point just behind its end.
    """
    longest = rays.longest + 1.5 * place.resolution
    for i in range(rays.points.shape[0]):
        dx = rays.points[i, 0] - rays.x
        dy = rays.points[i, 1] - rays.y
        if dx * dx + dy * dy > longest * longest:
            continue
        row, col = cell_at(place, rays.points[i, 0], rays.points[i, 1])
        if (
            row < row_0
            or row >= row_0 + before.shape[0]
            or col < col_0
            or col >= col_0 + before.shape[1]
        ):
            continue
        if before[row - row_0, col - col_0] == LETHAL:
            cells[row, col] = LETHAL


@kernel
def mark_points(cells: Costs, place: Place, rays: Rays) -> None:
    """Marks the cell of every point closer to the sensor than ``rays.longest`` as lethal."""
    rows, cols = cells.shape
    for i in range(rays.points.shape[0]):
        dx = rays.points[i, 0] - rays.x
        dy = rays.points[i, 1] - rays.y
        if dx * dx + dy * dy >= rays.longest * rays.longest:
            continue
        row, col = cell_at(place, rays.points[i, 0], rays.points[i, 1])
        if 0 <= row < rows and 0 <= col < cols:
            cells[row, col] = LETHAL


@njit
def polygon_covers(vertices, x, y):
    """Returns whether the point is inside the polygon (n, 2) by the even-odd rule."""
    inside = False
    last = vertices.shape[0] - 1
    for i in range(vertices.shape[0]):
        if (vertices[i, 1] > y) != (vertices[last, 1] > y):
            cross = (
                (vertices[last, 0] - vertices[i, 0])
                * (y - vertices[i, 1])
                / (vertices[last, 1] - vertices[i, 1])
            )
            if x < cross + vertices[i, 0]:
                inside = not inside
        last = i
    return inside


@kernel
def fill_polygon(cells: Costs, place: Place, vertices: Points, value: int) -> None:
    """Writes ``value`` into every cell that the polygon covers, its outline included."""
    rows, cols = cells.shape
    count = vertices.shape[0]
    scaled = np.empty((count, 2))
    row_min, row_max, col_min, col_max = rows, -1, cols, -1
    last_row, last_col = cell_at(place, vertices[count - 1, 0], vertices[count - 1, 1])
    for i in range(count):
        scaled[i, 0] = (vertices[i, 0] - place.x) / place.resolution
        scaled[i, 1] = (vertices[i, 1] - place.y) / place.resolution
        row, col = cell_at(place, vertices[i, 0], vertices[i, 1])
        row_min, row_max = min(row_min, row), max(row_max, row)
        col_min, col_max = min(col_min, col), max(col_max, col)
        set_line(cells, last_row, last_col, row, col, value)
        last_row, last_col = row, col
    for row in range(max(row_min, 0), min(row_max + 1, rows)):
        for col in range(max(col_min, 0), min(col_max + 1, cols)):
            if polygon_covers(scaled, col + 0.5, row + 0.5):
                cells[row, col] = value


@kernel
def merge_highest(master: Costs, layer: Costs, window: Bounds) -> None:
    """Merges the layer into the window of ``master`` by maximum; the layer's unknown cells change nothing."""
    row_0, row_1, col_0, col_1 = window
    for row in range(row_0, row_1):
        for col in range(col_0, col_1):
            cost = layer[row, col]
            if cost != UNKNOWN and (master[row, col] == UNKNOWN or master[row, col] < cost):
                master[row, col] = cost


@kernel
def merge_known(master: Costs, layer: Costs, window: Bounds) -> None:
    """Overwrites the window of ``master`` with the layer's known cells."""
    row_0, row_1, col_0, col_1 = window
    for row in range(row_0, row_1):
        for col in range(col_0, col_1):
            if layer[row, col] != UNKNOWN:
                master[row, col] = layer[row, col]


@kernel
def changed_window(
    cells: Costs, before: Costs, row_0: int, col_0: int, window: Array1[np.int64]
) -> None:
    """Extends ``window`` (row_0, row_1, col_0, col_1) to contain all cells that differ from ``before``.

    ``before`` is a copy of the part of ``cells`` that starts at ``row_0, col_0``.
    """
    for row in range(before.shape[0]):
        for col in range(before.shape[1]):
            if cells[row_0 + row, col_0 + col] != before[row, col]:
                window[0] = min(window[0], row_0 + row)
                window[1] = max(window[1], row_0 + row + 1)
                window[2] = min(window[2], col_0 + col)
                window[3] = max(window[3], col_0 + col + 1)


@njit
def _column_distance(cells, distance, row_0, row_1, col_0, col_1, radius):
    """Fills ``distance`` (window's shape) with the distance [cells] to the nearest lethal cell in the same column.

    Distances above ``radius`` are ``radius + 1``.
    """
    rows = cells.shape[0]
    width = col_1 - col_0
    running = np.full(width, radius + 1, np.int32)
    for row in range(max(row_0 - radius, 0), row_1):
        for i in range(width):
            running[i] = 0 if cells[row, col_0 + i] == LETHAL else min(running[i] + 1, radius + 1)
        if row >= row_0:
            distance[row - row_0, :] = running
    running[:] = radius + 1
    for row in range(min(row_1 + radius, rows) - 1, row_0 - 1, -1):
        for i in range(width):
            running[i] = 0 if cells[row, col_0 + i] == LETHAL else min(running[i] + 1, radius + 1)
        if row < row_1:
            for i in range(width):
                distance[row - row_0, i] = min(distance[row - row_0, i], running[i])


@njit
def envelope(heights, radius, sites, starts):
    """Finds the lower envelope of the parabolas ``(x - i)**2 + heights[i]**2``; returns their number.

    ``sites[k]`` is the position of the k-th parabola, which is lowest from ``starts[k]`` to ``starts[k + 1]``
    (Felzenszwalb and Huttenlocher, Distance Transforms of Sampled Functions, 2012). Heights above ``radius`` have none.
    """
    count = 0
    for i in range(heights.shape[0]):
        if heights[i] > radius:
            continue
        lift = heights[i] * heights[i] + i * i
        start = -1.0e18
        while count > 0:
            site = sites[count - 1]
            start = (lift - heights[site] * heights[site] - site * site) / (2.0 * (i - site))
            if start > starts[count - 1]:
                break
            count -= 1
        if count == 0:
            start = -1.0e18
        sites[count] = i
        starts[count] = start
        count += 1
    starts[count] = 1.0e18
    return count


@kernel
def inflate(
    cells: Costs, window: Bounds, radius: int, table: Array1[np.uint8], inflate_unknown: bool
) -> None:
    """Inflates the lethal cells within the window, using exact distances.

    Args:
        cells: costs; lethal cells outside the window count up to ``radius`` away.
        window: part of the grid to inflate.
        radius: inflation radius [cells].
        table: cost by squared distance [cells**2], ``radius**2 + 1`` entries.
        inflate_unknown: write every cost into unknown cells, not only inscribed cost and above.
    """
    row_0, row_1, col_0, col_1 = window
    left = max(col_0 - radius, 0)
    right = min(col_1 + radius, cells.shape[1])
    distance = np.empty((row_1 - row_0, right - left), np.int32)
    _column_distance(cells, distance, row_0, row_1, left, right, radius)
    sites = np.empty(right - left + 1, np.int64)
    starts = np.empty(right - left + 1, np.float64)
    for row in range(row_0, row_1):
        heights = distance[row - row_0]
        count = envelope(heights, radius, sites, starts)
        if count == 0:
            continue
        k = 0
        for col in range(col_0, col_1):
            x = col - left
            while starts[k + 1] < x:
                k += 1
            squared = (x - sites[k]) * (x - sites[k]) + heights[sites[k]] * heights[sites[k]]
            if squared > radius * radius:
                continue
            cost = table[squared]
            old = cells[row, col]
            if old == UNKNOWN:
                if cost >= INSCRIBED or (inflate_unknown and cost > FREE):
                    cells[row, col] = cost
            elif cost > old:
                cells[row, col] = cost
