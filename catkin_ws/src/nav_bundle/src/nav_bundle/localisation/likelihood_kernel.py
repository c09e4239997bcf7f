"""Sensor model kernels: distance fields, likelihood fields, ray casting.

Grids are row-major with row 0 at the origin; ``placement`` is their pose and scale in the map frame:
(origin x [m], origin y [m], cosine and sine of the origin's yaw, 1 / resolution [1/m]).
"""

import math
from typing import NamedTuple

import numpy as np

from nav_bundle.costmap.costmap_kernel import envelope
from pioneer_kernels.declaration import Array1, Array2, kernel, njit


class Field(NamedTuple):
    """Squared distances [cells²] to the nearest obstacle, from ``distance_field``, and the grid's placement."""

    squares: Array2[np.uint16]
    placement: Array1[np.float64]


@kernel
def distance_field(cells: Array2[np.int8], occupied: int, cap: int, out: Array2[np.uint16]) -> None:
    """Writes each cell's squared distance [cells²] to the nearest ``occupied`` cell, at most ``cap`` squared.

    Exact Euclidean distance in two passes: along columns (Meijster, Roerdink and Hesselink 2000), then along rows by
    `envelope`. ``cap`` is at most 255, so that squares fit into uint16.
    """
    rows, cols = cells.shape
    for col in range(cols):
        out[0, col] = 0 if cells[0, col] == occupied else cap
    for row in range(1, rows):
        for col in range(cols):
            out[row, col] = 0 if cells[row, col] == occupied else min(cap, out[row - 1, col] + 1)
    for row in range(rows - 2, -1, -1):
        for col in range(cols):
            below = out[row + 1, col] + 1
            if below < out[row, col]:
                out[row, col] = below
    heights = np.empty(cols, np.int64)
    sites = np.empty(cols + 1, np.int64)
    starts = np.empty(cols + 1, np.float64)
    most = cap * cap
    for row in range(rows):
        heights[:] = out[row]
        if envelope(heights, cap - 1, sites, starts) == 0:
            out[row] = most
            continue
        k = 0
        for col in range(cols):
            while starts[k + 1] < col:
                k += 1
            offset, height = col - sites[k], heights[sites[k]]
            out[row, col] = min(most, offset * offset + height * height)


@njit
def _squared_distance(pose, along, across, field):
    """Returns the squared distance [cells²] at a point [cells] in the frame of a pose ``_in_grid``; -1 off the grid."""
    x, y, cosine, sine = pose
    col, row = (
        math.floor(x + cosine * along - sine * across),
        math.floor(y + sine * along + cosine * across),
    )
    if 0 <= row < field.shape[0] and 0 <= col < field.shape[1]:
        return np.int64(field[np.int64(row), np.int64(col)])
    return np.int64(-1)


@njit
def _in_grid(pose, placement):
    """Returns a pose (x, y [m], yaw) of the map frame as (x, y [cells], cosine, sine of yaw) in the grid's frame."""
    dx, dy = pose[0] - placement[0], pose[1] - placement[1]
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    x = (placement[2] * dx + placement[3] * dy) * placement[4]
    y = (placement[2] * dy - placement[3] * dx) * placement[4]
    return (
        x,
        y,
        placement[2] * cosine + placement[3] * sine,
        placement[2] * sine - placement[3] * cosine,
    )


@kernel
def add_likelihoods(
    poses: Array2[np.float64],
    points: Array2[np.float64],
    field: Field,
    table: Array1[np.float64],
    out: Array1[np.float64],
) -> None:
    """Adds to ``out``, for each particle, the table's entries at its scan's end points.

    Args:
        poses: particles x, y [m], yaw [rad], shape (n, 3), map frame.
        points: end points of the beams [cells], robot frame, shape (m, 2).
        field: distances to obstacles.
        table: value by squared distance; its last entry also applies to points off the grid.
        out: sums, shape (n,).
    """
    outside = table[table.shape[0] - 1]
    for index in range(poses.shape[0]):
        pose = _in_grid(poses[index], field.placement)
        total = 0.0
        for beam in range(points.shape[0]):
            square = _squared_distance(pose, points[beam, 0], points[beam, 1], field.squares)
            total += table[square] if square >= 0 else outside
        out[index] += total


@kernel
def count_agreement(
    poses: Array2[np.float64],
    points: Array2[np.float64],
    field: Field,
    nearest: int,
    counts: Array1[np.int64],
) -> None:
    """Counts, for each beam, the particles that have an obstacle within ``nearest`` [cells²] of its end point."""
    for index in range(poses.shape[0]):
        pose = _in_grid(poses[index], field.placement)
        for beam in range(points.shape[0]):
            square = _squared_distance(pose, points[beam, 0], points[beam, 1], field.squares)
            if 0 <= square < nearest:
                counts[beam] += 1


@kernel
def expected_ranges(
    poses: Array2[np.float64],
    laser: Array1[np.float64],
    bearings: Array1[np.float64],
    cells: Array2[np.int8],
    placement: Array1[np.float64],
    longest: float,
    out: Array2[np.float64],
) -> None:
    """Writes the range [m] that each particle's laser would measure in the map, at most ``longest``.

    A ray ends in the first cell that is not free (unknown cells stop it, too). A ray that leaves the grid gives
    ``longest``.

    Args:
        poses: particles x, y [m], yaw [rad], shape (n, 3), map frame.
        laser: x, y [m], yaw [rad] of the laser in the robot frame.
        bearings: directions [rad] in the laser frame, shape (m,).
        cells: occupancy of the map.
        placement: placement of the cells.
        longest: maximum range [m].
        out: ranges, shape (n, m).
    """
    limit = longest * placement[4]
    turn = math.cos(laser[2]), math.sin(laser[2])
    for index in range(poses.shape[0]):
        x, y, cosine, sine = _in_grid(poses[index], placement)
        eye_x = x + (cosine * laser[0] - sine * laser[1]) * placement[4]
        eye_y = y + (sine * laser[0] + cosine * laser[1]) * placement[4]
        for beam in range(bearings.shape[0]):
            bx, by = math.cos(bearings[beam]), math.sin(bearings[beam])
            lx, ly = turn[0] * bx - turn[1] * by, turn[1] * bx + turn[0] * by
            reach = _ray(
                eye_x, eye_y, cosine * lx - sine * ly, sine * lx + cosine * ly, cells, limit
            )
            out[index, beam] = reach / placement[4]


@njit
def _ray(x, y, dx, dy, cells, limit):
    """Returns the length [cells] of a ray from (x, y) along unit vector (dx, dy), by Amanatides and Woo's traversal."""
    col, row = np.int64(math.floor(x)), np.int64(math.floor(y))
    step_col, step_row = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    delta_col = abs(1.0 / dx) if dx != 0.0 else math.inf
    delta_row = abs(1.0 / dy) if dy != 0.0 else math.inf
    next_col = (col + (1 if dx > 0 else 0) - x) / dx if dx != 0.0 else math.inf
    next_row = (row + (1 if dy > 0 else 0) - y) / dy if dy != 0.0 else math.inf
    travelled = 0.0
    while travelled < limit:
        if not (0 <= row < cells.shape[0] and 0 <= col < cells.shape[1]):
            return limit
        if cells[row, col] != 0:
            return travelled
        if next_col < next_row:
            travelled, next_col, col = next_col, next_col + delta_col, col + step_col
        else:
            travelled, next_row, row = next_row, next_row + delta_row, row + step_row
    return limit
