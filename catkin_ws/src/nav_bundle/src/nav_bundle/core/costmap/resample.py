"""Resampling of one grid's cells into another grid."""

import math

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core.costmap.cost import cells_of_distance
from nav_bundle.core.costmap.geometry import Geometry, Window
from nav_bundle.core.pose import Pose

_ROWS_AT_ONCE = 256  # bounds the temporary memory for large maps


def upright(origin: Pose, resolution: float, rows: int, cols: int) -> Geometry:
    """Returns the smallest axis-aligned grid that contains a rotated grid whose corner is at ``origin``."""
    corners = [origin.apply(x * resolution, y * resolution) for x in (0, cols) for y in (0, rows)]
    left, right = min(x for x, _ in corners), max(x for x, _ in corners)
    bottom, top = min(y for _, y in corners), max(y for _, y in corners)
    size = cells_of_distance(top - bottom, resolution), cells_of_distance(right - left, resolution)
    return Geometry(left, bottom, resolution, *size)


def sampled(
    cells: NDArray[np.uint8], origin: Pose, resolution: float, place: Geometry, window: Window, outside: int
) -> NDArray[np.uint8]:
    """Returns ``cells`` sampled at the centres of the window's cells (nearest cell).

    Args:
        cells: uint8, shape (rows, cols).
        origin: pose of the corner of ``cells`` in the frame of ``place``.
        resolution: cell size of ``cells`` [m].
        place: geometry of the target grid.
        window: part of the target grid to sample.
        outside: value where ``cells`` do not reach.
    """
    found = np.full((window.row_1 - window.row_0, window.col_1 - window.col_0), outside, np.uint8)
    cosine, sine = math.cos(origin.yaw), math.sin(origin.yaw)
    dx = place.origin_x + (np.arange(window.col_0, window.col_1) + 0.5) * place.resolution - origin.x
    for first in range(0, len(found), _ROWS_AT_ONCE):
        part = found[first : first + _ROWS_AT_ONCE]
        rows = np.arange(window.row_0 + first, window.row_0 + first + len(part))
        dy = (place.origin_y + (rows + 0.5) * place.resolution - origin.y)[:, None]
        col = np.floor((cosine * dx + sine * dy) / resolution).astype(np.int32)
        row = np.floor((cosine * dy - sine * dx) / resolution).astype(np.int32)
        inside = (row >= 0) & (row < cells.shape[0]) & (col >= 0) & (col < cells.shape[1])
        part[inside] = cells[row[inside], col[inside]]
    return found
