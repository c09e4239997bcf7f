"""Distances over a local costmap, in steps from cell to cell: to the plan and to its end (base_local_planner's)."""

import numpy as np
from numba import njit

from nav_bundle.kernels.costmap import INSCRIBED, UNKNOWN, fill_polygon

SIGNATURES = {
    "distance_grids": "i8(u1[:, ::1], f8, f8, f8, f8[:, ::1], f8[:, ::1], i4[:, ::1], i4[:, ::1], i4[::1])",
    "goal_grid": "i8(u1[:, ::1], f8, f8, f8, f8[:, ::1], f8[:, ::1], i4[:, ::1], i4[::1])",
}


@njit
def _plan_cells(costs, origin_x, origin_y, resolution, plan, cells):
    """Writes the flat indices of the known cells that the plan crosses on its first way through the grid.

    Returns their number; at most one entry per cell of ``cells``.
    """
    rows, cols = costs.shape
    count = 0
    for i in range(plan.shape[0]):
        before = i - 1 if i > 0 else 0
        dx = plan[i, 0] - plan[before, 0]
        dy = plan[i, 1] - plan[before, 1]
        parts = max(1, int(np.ceil(np.sqrt(dx * dx + dy * dy) / resolution)))
        for part in range(1, parts + 1):
            x = plan[before, 0] + dx * part / parts
            y = plan[before, 1] + dy * part / parts
            row = int(np.floor((y - origin_y) / resolution))
            col = int(np.floor((x - origin_x) / resolution))
            if row < 0 or row >= rows or col < 0 or col >= cols or costs[row, col] == UNKNOWN:
                if count > 0:
                    return count
                continue
            cell = row * cols + col
            if (count == 0 or cells[count - 1] != cell) and count < cells.shape[0]:
                cells[count] = cell
                count += 1
    return count


@njit
def _flood(costs, inside, distance, queue, count):
    """Fills ``distance`` by steps between edge neighbours from the ``count`` cells queued with distance 0.

    Obstacles, except under the robot, get the number of cells; what cannot be reached one more.
    """
    rows, cols = costs.shape
    head = 0
    while head < count:
        cell = queue[head]
        head += 1
        row = cell // cols
        col = cell - row * cols
        onwards = distance[row, col] + 1
        for d_row, d_col in ((0, -1), (0, 1), (-1, 0), (1, 0)):
            r = row + d_row
            c = col + d_col
            if r < 0 or r >= rows or c < 0 or c >= cols or distance[r, c] != rows * cols + 1:
                continue
            if costs[r, c] >= INSCRIBED and inside[r, c] == 0:
                distance[r, c] = rows * cols
                continue
            distance[r, c] = onwards
            queue[count] = r * cols + c
            count += 1


@njit
def _flood_from(costs, inside, distance, queue, cell):
    cols = costs.shape[1]
    distance[cell // cols, cell % cols] = 0
    queue[0] = cell
    _flood(costs, inside, distance, queue, 1)


def distance_grids(costs, origin_x, origin_y, resolution, plan, outline, to_plan, to_goal, queue):
    """Fills the two grids that trajectories are scored on; returns how many cells the plan crosses, 0 if none.

    Args:
        costs: the local costmap.
        origin_x: corner of cell (0, 0) [m].
        origin_y: corner of cell (0, 0) [m].
        resolution: [m].
        plan: points (n, 2) [m] in the costmap's frame.
        outline: the footprint's vertices (m, 2) [m] at the robot's pose.
        to_plan: steps to the plan, for every cell.
        to_goal: steps to the plan's last cell inside the costmap.
        queue: room for one entry per cell.
    """
    rows, cols = costs.shape
    inside = np.zeros((rows, cols), np.uint8)
    fill_polygon(inside, origin_x, origin_y, resolution, outline, np.uint8(1))
    to_plan[:, :] = rows * cols + 1
    to_goal[:, :] = rows * cols + 1
    crossed = np.empty(rows * cols, np.int32)
    crossings = _plan_cells(costs, origin_x, origin_y, resolution, plan, crossed)
    if crossings == 0:
        return 0
    count = 0
    for i in range(crossings):
        row = crossed[i] // cols
        col = crossed[i] - row * cols
        if to_plan[row, col] != 0:
            to_plan[row, col] = 0
            queue[count] = crossed[i]
            count += 1
    _flood(costs, inside, to_plan, queue, count)
    _flood_from(costs, inside, to_goal, queue, crossed[crossings - 1])
    return crossings


def goal_grid(costs, origin_x, origin_y, resolution, plan, outline, to_goal, queue):
    """Fills only ``to_goal`` of ``distance_grids``; returns how many cells the plan crosses, 0 if none."""
    rows, cols = costs.shape
    inside = np.zeros((rows, cols), np.uint8)
    fill_polygon(inside, origin_x, origin_y, resolution, outline, np.uint8(1))
    to_goal[:, :] = rows * cols + 1
    crossed = np.empty(rows * cols, np.int32)
    crossings = _plan_cells(costs, origin_x, origin_y, resolution, plan, crossed)
    if crossings == 0:
        return 0
    _flood_from(costs, inside, to_goal, queue, crossed[crossings - 1])
    return crossings
