"""Costmap kernels: rays that clear and mark, layers that merge, inflation by an exact distance transform.

Grids are ``[row, col]`` of unsigned bytes with costmap_2d's meaning: 0 free, 253 inscribed,
254 lethal, 255 unknown. Windows are half-open: rows ``[row_0, row_1)``, columns ``[col_0, col_1)``.
"""

import numpy as np
from numba import njit

FREE = 0
INSCRIBED = 253
LETHAL = 254
UNKNOWN = 255

SIGNATURES = {
    "clear_rays": "void(u1[:, ::1], f8, f8, f8, f8, f8, f8[:, ::1], f8)",
    "mark_points": "void(u1[:, ::1], f8, f8, f8, f8, f8, f8[:, ::1], f8)",
    "fill_polygon": "void(u1[:, ::1], f8, f8, f8, f8[:, ::1], u1)",
    "merge_highest": "void(u1[:, ::1], u1[:, ::1], i8, i8, i8, i8)",
    "merge_known": "void(u1[:, ::1], u1[:, ::1], i8, i8, i8, i8)",
    "changed_window": "void(u1[:, ::1], u1[:, ::1], i8, i8, i8[::1])",
    "inflate": "void(u1[:, ::1], i8, i8, i8, i8, i8, u1[::1], b1)",
}


@njit
def line_between(row_0, col_0, row_1, col_1):
    """Returns Bresenham's line for ``next_cell``: cells after the first one, those along each axis, directions."""
    d_row = abs(row_1 - row_0)
    d_col = abs(col_1 - col_0)
    return max(d_row, d_col), d_row, d_col, 1 if row_1 > row_0 else -1, 1 if col_1 > col_0 else -1


@njit
def next_cell(row, col, error_row, error_col, line):
    """Returns the line's next cell and both errors there; they are half of ``line[0]`` in its first cell."""
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
def _clear_line(cells, row_0, col_0, row_1, col_1):
    """Frees the cells of Bresenham's line, both ends included, until it leaves the grid."""
    rows, cols = cells.shape
    line = line_between(row_0, col_0, row_1, col_1)
    row, col, error_row, error_col = row_0, col_0, line[0] // 2, line[0] // 2
    for _ in range(line[0] + 1):
        if row < 0 or row >= rows or col < 0 or col >= cols:
            return
        cells[row, col] = FREE
        row, col, error_row, error_col = next_cell(row, col, error_row, error_col, line)


def clear_rays(cells, origin_x, origin_y, resolution, sensor_x, sensor_y, points, longest):
    """Frees what lies between the sensor and each point (n, 2) [m], as far as ``longest`` [m]."""
    rows, cols = cells.shape
    row_0 = int(np.floor((sensor_y - origin_y) / resolution))
    col_0 = int(np.floor((sensor_x - origin_x) / resolution))
    if row_0 < 0 or row_0 >= rows or col_0 < 0 or col_0 >= cols:
        return
    for i in range(points.shape[0]):
        dx = points[i, 0] - sensor_x
        dy = points[i, 1] - sensor_y
        distance = np.sqrt(dx * dx + dy * dy)
        if distance > longest:
            dx *= longest / distance
            dy *= longest / distance
        row_1 = int(np.floor((sensor_y + dy - origin_y) / resolution))
        col_1 = int(np.floor((sensor_x + dx - origin_x) / resolution))
        _clear_line(cells, row_0, col_0, row_1, col_1)


def mark_points(cells, origin_x, origin_y, resolution, sensor_x, sensor_y, points, longest):
    """Makes the cell of every point (n, 2) [m] nearer to the sensor than ``longest`` [m] lethal."""
    rows, cols = cells.shape
    for i in range(points.shape[0]):
        dx = points[i, 0] - sensor_x
        dy = points[i, 1] - sensor_y
        if dx * dx + dy * dy >= longest * longest:
            continue
        row = int(np.floor((points[i, 1] - origin_y) / resolution))
        col = int(np.floor((points[i, 0] - origin_x) / resolution))
        if 0 <= row < rows and 0 <= col < cols:
            cells[row, col] = LETHAL


@njit
def polygon_covers(vertices, x, y):
    """True if the point lies inside the polygon (n, 2) by the even-odd rule."""
    inside = False
    last = vertices.shape[0] - 1
    for i in range(vertices.shape[0]):
        if (vertices[i, 1] > y) != (vertices[last, 1] > y):
            cross = (vertices[last, 0] - vertices[i, 0]) * (y - vertices[i, 1]) / (vertices[last, 1] - vertices[i, 1])
            if x < cross + vertices[i, 0]:
                inside = not inside
        last = i
    return inside


@njit
def set_line(cells, row_0, col_0, row_1, col_1, value):
    """Writes ``value`` along Bresenham's line, skipping what lies outside the grid."""
    rows, cols = cells.shape
    line = line_between(row_0, col_0, row_1, col_1)
    row, col, error_row, error_col = row_0, col_0, line[0] // 2, line[0] // 2
    for _ in range(line[0] + 1):
        if 0 <= row < rows and 0 <= col < cols:
            cells[row, col] = value
        row, col, error_row, error_col = next_cell(row, col, error_row, error_col, line)


@njit
def fill_polygon(cells, origin_x, origin_y, resolution, vertices, value):
    """Writes ``value`` into every cell that the polygon (n, 2) [m] covers, its outline included."""
    rows, cols = cells.shape
    count = vertices.shape[0]
    scaled = np.empty((count, 2))
    row_min, row_max, col_min, col_max = rows, -1, cols, -1
    for i in range(count):
        scaled[i, 0] = (vertices[i, 0] - origin_x) / resolution
        scaled[i, 1] = (vertices[i, 1] - origin_y) / resolution
        row_min = min(row_min, int(np.floor(scaled[i, 1])))
        row_max = max(row_max, int(np.floor(scaled[i, 1])))
        col_min = min(col_min, int(np.floor(scaled[i, 0])))
        col_max = max(col_max, int(np.floor(scaled[i, 0])))
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        set_line(
            cells,
            int(np.floor(scaled[i, 1])),
            int(np.floor(scaled[i, 0])),
            int(np.floor(scaled[j, 1])),
            int(np.floor(scaled[j, 0])),
            value,
        )
    for row in range(max(row_min, 0), min(row_max + 1, rows)):
        for col in range(max(col_min, 0), min(col_max + 1, cols)):
            if polygon_covers(scaled, col + 0.5, row + 0.5):
                cells[row, col] = value


def merge_highest(master, layer, row_0, row_1, col_0, col_1):
    """Takes the higher cost of both in the window; what the layer does not know changes nothing."""
    for row in range(row_0, row_1):
        for col in range(col_0, col_1):
            cost = layer[row, col]
            if cost != UNKNOWN and (master[row, col] == UNKNOWN or master[row, col] < cost):
                master[row, col] = cost


def merge_known(master, layer, row_0, row_1, col_0, col_1):
    """Replaces the master by what the layer knows in the window."""
    for row in range(row_0, row_1):
        for col in range(col_0, col_1):
            if layer[row, col] != UNKNOWN:
                master[row, col] = layer[row, col]


def changed_window(cells, before, row_0, col_0, window):
    """Widens ``window`` (row_0, row_1, col_0, col_1) by the cells that differ from ``before``.

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
    """Fills ``distance`` (window's shape) with the steps to the nearest lethal cell of the same column.

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
def _envelope(heights, radius, sites, starts):
    """Finds the lower envelope of the parabolas ``(x - i)**2 + heights[i]**2``; returns their number.

    ``sites[k]`` is the k-th parabola's position, lowest from ``starts[k]`` to ``starts[k + 1]``
    (Felzenszwalb and Huttenlocher, Distance Transforms of Sampled Functions, 2012).
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


def inflate(cells, row_0, row_1, col_0, col_1, radius, table, inflate_unknown):
    """Spreads costs around the lethal cells into the window, exact to the cell.

    Args:
        cells: costs; lethal cells outside the window count as far as ``radius`` reaches.
        row_0: first row of the window.
        row_1: row after the window.
        col_0: first column of the window.
        col_1: column after the window.
        radius: [cells].
        table: cost by squared distance [cells**2], ``radius**2 + 1`` entries.
        inflate_unknown: spread every cost into unknown cells, not only inscribed ones.
    """
    left = max(col_0 - radius, 0)
    right = min(col_1 + radius, cells.shape[1])
    distance = np.empty((row_1 - row_0, right - left), np.int32)
    _column_distance(cells, distance, row_0, row_1, left, right, radius)
    sites = np.empty(right - left + 1, np.int64)
    starts = np.empty(right - left + 1, np.float64)
    for row in range(row_0, row_1):
        heights = distance[row - row_0]
        count = _envelope(heights, radius, sites, starts)
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
