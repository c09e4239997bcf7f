"""Distance grids over a local costmap, in cell steps, to the plan and to its end, as in base_local_planner."""

from typing import NamedTuple

import numpy as np

from nav_bundle.costmap.costmap_kernel import (
    INSCRIBED,
    UNKNOWN,
    Costs,
    Place,
    Points,
    cell_at,
    fill_polygon,
)
from pioneer_kernels.declaration import Array1, Array2, kernel, njit

Steps = Array2[np.int32]
"""Distances of a grid's cells to a target, in cell steps."""
Queue = Array1[np.int32]
"""Scratch space with one entry per cell."""


class Floor(NamedTuple):
    """The local costmap, and the vertices of the robot's footprint at its pose."""

    costs: Costs
    place: Place
    outline: Points


@njit
def _plan_cells(floor, plan, cells):
    """Writes the flat indices of the known cells that the plan crosses, until it first leaves the known grid.

    Returns their number, at most the length of ``cells``.
    """
    rows, cols = floor.costs.shape
    count = 0
    for i in range(plan.shape[0]):
        before = i - 1 if i > 0 else 0
        dx = plan[i, 0] - plan[before, 0]
        dy = plan[i, 1] - plan[before, 1]
        parts = max(1, int(np.ceil(np.sqrt(dx * dx + dy * dy) / floor.place.resolution)))
        for part in range(1, parts + 1):
            row, col = cell_at(
                floor.place,
                plan[before, 0] + dx * part / parts,
                plan[before, 1] + dy * part / parts,
            )
            if row < 0 or row >= rows or col < 0 or col >= cols or floor.costs[row, col] == UNKNOWN:
                if count > 0:
                    return count
                continue
            cell = row * cols + col
            if (count == 0 or cells[count - 1] != cell) and count < cells.shape[0]:
                cells[count] = cell
                count += 1
    return count


@njit
def _flood(costs, inside, distance, queue, starts):
    """Fills ``distance`` by steps between edge neighbours from the cells ``starts`` (flat indices).

    Obstacles outside the footprint get the number of cells, unreachable cells that number plus one.
    """
    rows, cols = costs.shape
    distance[:, :] = rows * cols + 1
    head = count = 0
    for cell in starts:
        if distance[cell // cols, cell % cols] != 0:
            distance[cell // cols, cell % cols] = 0
            queue[count] = cell
            count += 1
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
def _inside(floor):
    """Returns a grid that is 1 under the robot's footprint and 0 elsewhere."""
    inside = np.zeros(floor.costs.shape, np.uint8)
    fill_polygon(inside, floor.place, floor.outline, 1)
    return inside


@kernel
def distance_grids(floor: Floor, plan: Points, to_plan: Steps, to_goal: Steps, queue: Queue) -> int:
    """Fills the two grids that trajectories are scored on; returns the number of cells that the plan crosses.

    Args:
        floor: costmap and footprint.
        plan: points in the costmap's frame.
        to_plan: steps to the plan, for every cell.
        to_goal: steps to the plan's last cell inside the costmap.
        queue: scratch space.
    """
    inside = _inside(floor)
    crossed = np.empty(floor.costs.size, np.int32)
    crossings = _plan_cells(floor, plan, crossed)
    _flood(floor.costs, inside, to_plan, queue, crossed[:crossings])
    _flood(floor.costs, inside, to_goal, queue, crossed[max(crossings - 1, 0) : crossings])
    return crossings


@kernel
def goal_grid(floor: Floor, plan: Points, to_goal: Steps, queue: Queue) -> int:
    """Fills only ``to_goal`` of ``distance_grids``; returns the number of cells that the plan crosses."""
    crossed = np.empty(floor.costs.size, np.int32)
    crossings = _plan_cells(floor, plan, crossed)
    _flood(floor.costs, _inside(floor), to_goal, queue, crossed[max(crossings - 1, 0) : crossings])
    return crossings
