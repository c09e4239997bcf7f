"""Footprint kernels: the costs under a robot's outline."""

import numpy as np

from nav_bundle.costmap.costmap_kernel import (
    LETHAL,
    Costs,
    Place,
    Points,
    cell_at,
    line_between,
    next_cell,
)
from pioneer_kernels.declaration import kernel, njit


@njit
def line_cost(costs, row_0, col_0, row_1, col_1):
    """Returns the highest cost along Bresenham's line; -1 if it crosses a lethal cell, -2 an unknown one."""
    line = line_between(row_0, col_0, row_1, col_1)
    row, col, error_row, error_col = row_0, col_0, line[0] // 2, line[0] // 2
    highest = 0
    for _ in range(line[0] + 1):
        cost = costs[row, col]
        if cost >= LETHAL:
            return -1 if cost == LETHAL else -2
        highest = max(highest, np.int64(cost))
        row, col, error_row, error_col = next_cell(row, col, error_row, error_col, line)
    return highest


@kernel
def footprint_cost(
    costs: Costs, place: Place, footprint: Points, x: float, y: float, yaw: float
) -> int:
    """Returns the highest cost under the footprint's outline at a pose.

    Returns -1 if it crosses a lethal cell, -2 an unknown one, -3 if it leaves the grid.
    """
    return outline_cost(costs, place, footprint, x, y, np.cos(yaw), np.sin(yaw))


@njit
def outline_cost(costs, place, footprint, x, y, cosine, sine):
    """Returns ``footprint_cost`` at a pose given by the cosine and sine of its heading."""
    rows, cols = costs.shape
    count = footprint.shape[0]
    last_row = last_col = 0
    highest = 0
    for i in range(count + 1):
        j = i if i < count else 0
        vertex_x = x + cosine * footprint[j, 0] - sine * footprint[j, 1]
        vertex_y = y + sine * footprint[j, 0] + cosine * footprint[j, 1]
        row, col = cell_at(place, vertex_x, vertex_y)
        if row < 0 or row >= rows or col < 0 or col >= cols:
            return -3
        if i > 0:
            cost = line_cost(costs, last_row, last_col, row, col)
            if cost < 0:
                return cost
            highest = max(highest, cost)
        last_row, last_col = row, col
    return highest
