"""Planar ray casting against segments and circles in a uniform grid, and against moving outlines.

A segment is a row (ax, ay, ex, ey): one end and the vector to the other [m]. A circle is a row (x, y, radius) [m].
The grid has square cells of side ``cell`` from the corner (x0, y0); cell ``k = row * cols + col`` holds
``items[starts[k]:starts[k + 1]]``: numbers below the number of segments are segments, the others circles.

The grid traversal is that of Amanatides and Woo, "A fast voxel traversal algorithm" (1987).
"""

import math
from typing import NamedTuple

import numpy as np

from pioneer_kernels.declaration import Array1, Array2, kernel, njit


class Walls(NamedTuple):
    """Segments and circles with their grid: corner and cell side [m], number of rows and columns."""

    segments: Array2[np.float64]
    circles: Array2[np.float64]
    x0: float
    y0: float
    cell: float
    rows: int
    cols: int


class Outlines(NamedTuple):
    """Moving outlines: outline ``k`` is ``segments[starts[k]:starts[k + 1]]``, in its mover's frame.

    ``radii`` [m] are those of bounding circles about the movers' origins.
    """

    segments: Array2[np.float64]
    starts: Array1[np.int32]
    radii: Array1[np.float64]


class Sensor(NamedTuple):
    """Pose of a sensor in the plane [m, rad]."""

    x: float
    y: float
    yaw: float


class Fan(NamedTuple):
    """A scan's beams: angle of the first one relative to the sensor's heading, increment [rad], and length [m]."""

    first: float
    increment: float
    reach: float


class Reading(NamedTuple):
    """Parameters for converting distances to ranges."""

    mean: float  #: mean of the noise [m]
    deviation: float  #: standard deviation of the noise [m]
    least: float  #: minimum range [m]; smaller distances become -inf
    most: float  #: maximum range [m]; larger distances become +inf


GRAZE = 1e-9
"""A beam that passes an end of a segment at most this far outside [m] hits it: of two that share it, one is hit."""

PARALLEL = 1e-6
"""Below this, the length of a segment across a beam [m] is too small for a quotient to tell where they meet."""


@njit(inline="always")
def _segment_distance(
    wx: float, wy: float, ex: float, ey: float, dx: float, dy: float, most: float
) -> float:
    """Returns the distance along a ray to a segment; ``most`` if it is not hit nearer than that.

    The segment begins at (wx, wy) relative to the ray's origin; (ex, ey) leads to its other end, and (dx, dy) is the
    ray's unit vector.
    """
    across = dx * ey - dy * ex
    aside = wx * dy - wy * dx
    along = wx * ey - wy * ex
    if across < 0.0:
        across, aside, along = -across, -aside, -along
    if across == 0.0 or aside < -GRAZE or aside > across + GRAZE:
        return most
    distance = along / across
    if across < PARALLEL:
        first = wx * dx + wy * dy
        second = first + ex * dx + ey * dy
        distance = min(max(distance, min(first, second)), max(first, second))
    return distance if 0.0 <= distance < most else most


@njit(inline="always")
def _clamped(value: int, low: int, high: int) -> int:
    return min(max(value, low), high)


@njit
def _segment_meets_cell(
    ax: float, ay: float, ex: float, ey: float, left: float, bottom: float, cell: float
) -> bool:
    """Tests whether a segment touches a cell, on the segment's normal only; the caller has tested the box axes."""
    margin = 1e-9 + 1e-9 * cell
    half = 0.5 * cell
    cx, cy = left + half, bottom + half
    reach = (half + margin) * (abs(ex) + abs(ey))
    return abs((cx - ax) * ey - (cy - ay) * ex) <= reach


@njit
def _visit(walls: Walls, starts: Array1[np.int32], items: Array1[np.int32], store: int) -> None:
    """Counts (store 0) or stores (store 1) each item in every cell it may touch; advances ``starts``."""
    segments, circles, x0, y0, cell, rows, cols = walls
    margin = 1e-7
    for k in range(segments.shape[0]):
        ax, ay, ex, ey = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        c0 = int(_clamped(math.floor((min(ax, ax + ex) - x0 - margin) / cell), 0, cols - 1))
        c1 = int(_clamped(math.floor((max(ax, ax + ex) - x0 + margin) / cell), 0, cols - 1))
        r0 = int(_clamped(math.floor((min(ay, ay + ey) - y0 - margin) / cell), 0, rows - 1))
        r1 = int(_clamped(math.floor((max(ay, ay + ey) - y0 + margin) / cell), 0, rows - 1))
        for r in range(r0, r1 + 1):
            for c in range(c0, c1 + 1):
                if _segment_meets_cell(ax, ay, ex, ey, x0 + c * cell, y0 + r * cell, cell):
                    if store:
                        items[starts[r * cols + c]] = k
                    starts[r * cols + c] += 1
    for k in range(circles.shape[0]):
        x, y, radius = circles[k, 0], circles[k, 1], circles[k, 2]
        c0 = int(_clamped(math.floor((x - radius - x0) / cell), 0, cols - 1))
        c1 = int(_clamped(math.floor((x + radius - x0) / cell), 0, cols - 1))
        r0 = int(_clamped(math.floor((y - radius - y0) / cell), 0, rows - 1))
        r1 = int(_clamped(math.floor((y + radius - y0) / cell), 0, rows - 1))
        for r in range(r0, r1 + 1):
            for c in range(c0, c1 + 1):
                if store:
                    items[starts[r * cols + c]] = segments.shape[0] + k
                starts[r * cols + c] += 1


@kernel
def count_items(walls: Walls, counts: Array1[np.int32]) -> None:
    """Adds the number of items per cell to ``counts``, shape (rows * cols,)."""
    _visit(walls, counts, counts, 0)


@kernel
def fill_items(walls: Walls, cursors: Array1[np.int32], items: Array1[np.int32]) -> None:
    """Writes each cell's items from position ``cursors[cell]`` on, advancing the cursor."""
    _visit(walls, cursors, items, 1)


@njit(inline="always")
def _circle_distance(
    px: float, py: float, dx: float, dy: float, x: float, y: float, radius: float
) -> float:
    """Returns the distance along the ray to the circle's rim; infinity if it is not hit."""
    mx, my = px - x, py - y
    b = mx * dx + my * dy
    c = mx * mx + my * my - radius * radius
    disc = b * b - c
    if disc < 0.0:
        return math.inf
    root = math.sqrt(disc)
    near = -b - root
    if near >= 0.0:
        return near
    far = -b + root
    return far if far >= 0.0 else math.inf


@njit(fastmath={"contract"})
def _cast_one(
    walls: Walls,
    starts: Array1[np.int32],
    items: Array1[np.int32],
    px: float,
    py: float,
    dx: float,
    dy: float,
    max_range: float,
) -> float:
    segments, circles, x0, y0, cell, rows, cols = walls
    count = segments.shape[0]
    best = max_range
    # Clip the ray to the grid's rectangle.
    inv_x = 1.0 / dx if dx != 0.0 else math.inf
    inv_y = 1.0 / dy if dy != 0.0 else math.inf
    t_in, t_out = 0.0, best
    if dx != 0.0:
        t1, t2 = (x0 - px) * inv_x, (x0 + cols * cell - px) * inv_x
        t_in, t_out = max(t_in, min(t1, t2)), min(t_out, max(t1, t2))
    elif px < x0 or px > x0 + cols * cell:
        return best
    if dy != 0.0:
        t1, t2 = (y0 - py) * inv_y, (y0 + rows * cell - py) * inv_y
        t_in, t_out = max(t_in, min(t1, t2)), min(t_out, max(t1, t2))
    elif py < y0 or py > y0 + rows * cell:
        return best
    if t_in > t_out:
        return best
    col = int(_clamped(math.floor((px + t_in * dx - x0) / cell), 0, cols - 1))
    row = int(_clamped(math.floor((py + t_in * dy - y0) / cell), 0, rows - 1))
    step_col = 1 if dx > 0.0 else -1
    step_row = 1 if dy > 0.0 else -1
    next_x = (x0 + (col + (1 if dx > 0.0 else 0)) * cell - px) * inv_x if dx != 0.0 else math.inf
    next_y = (y0 + (row + (1 if dy > 0.0 else 0)) * cell - py) * inv_y if dy != 0.0 else math.inf
    delta_x, delta_y = abs(cell * inv_x), abs(cell * inv_y)
    while True:
        k = row * cols + col
        for i in range(starts[k], starts[k + 1]):
            item = items[i]
            if item < count:
                wx, wy = segments[item, 0] - px, segments[item, 1] - py
                best = _segment_distance(wx, wy, segments[item, 2], segments[item, 3], dx, dy, best)
            else:
                q = item - count
                t = _circle_distance(px, py, dx, dy, circles[q, 0], circles[q, 1], circles[q, 2])
                if t < best:
                    best = t
        exit_at = min(next_x, next_y)
        if best <= exit_at or exit_at > t_out:
            return best
        if next_x < next_y:
            col += step_col
            next_x += delta_x
            if col < 0 or col >= cols:
                return best
        else:
            row += step_row
            next_y += delta_y
            if row < 0 or row >= rows:
                return best


@kernel
def cast(
    walls: Walls,
    starts: Array1[np.int32],
    items: Array1[np.int32],
    sensor: Sensor,
    fan: Fan,
    out: Array1[np.float64],
) -> None:
    """Writes the distance [m] along each beam to ``out``; ``fan.reach`` for no hit.

    Beam ``i`` points along ``sensor.yaw + fan.first + i * fan.increment`` [rad].
    """
    for i in range(out.shape[0]):
        angle = sensor.yaw + fan.first + i * fan.increment
        out[i] = _cast_one(
            walls, starts, items, sensor.x, sensor.y, math.cos(angle), math.sin(angle), fan.reach
        )


@njit
def _shorten(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    yaw_first: float,
    increment: float,
    turn_beams: float,
    out: Array1[np.float64],
) -> None:
    """Shortens the beams that cross a segment, given relative to the sensor; tests only beams between its ends."""
    start = math.atan2(ay, ax)
    sweep = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    if sweep < 0.0:
        start += sweep
        sweep = -sweep
    ex, ey = bx - ax, by - ay
    if increment == 0.0:
        low, high = 0, out.shape[0] - 1
        shift = 0
    else:
        offset = (start - yaw_first) / increment
        span = sweep / increment
        if span < 0.0:
            offset += span
            span = -span
        offset -= math.floor(offset / turn_beams) * turn_beams
        low, high = math.floor(offset), math.ceil(offset + span)
        shift = math.ceil(turn_beams)
    n = out.shape[0]
    # The first beam can have any direction, so the interval may wrap once.
    for wrap in range(2):
        first, last = low, high
        if wrap:
            if shift == 0 or high - turn_beams < -1.0:
                break
            first, last = math.floor(low - turn_beams), math.ceil(high - turn_beams)
        for i in range(max(first, 0), min(last, n - 1) + 1):
            angle = yaw_first + i * increment
            out[i] = _segment_distance(ax, ay, ex, ey, math.cos(angle), math.sin(angle), out[i])


@kernel
def cast_movers(
    outlines: Outlines,
    poses: Array2[np.float64],
    own: int,
    sensor: Sensor,
    fan: Fan,
    out: Array1[np.float64],
) -> None:
    """Shortens the beams in ``out`` that hit moving outlines.

    Args:
        outlines: of the movers.
        poses: (movers, 3) x, y, yaw [m, rad] in the world.
        own: index of the mover that carries the sensor, which is ignored; -1 for none.
        sensor: as in ``cast``.
        fan: as in ``cast``.
        out: distances from ``cast``, updated in place.
    """
    segments, starts, radii = outlines
    turn_beams = math.tau / abs(fan.increment) if fan.increment != 0.0 else 1.0
    for k in range(poses.shape[0]):
        if k == own or starts[k] == starts[k + 1]:
            continue
        rx, ry = poses[k, 0] - sensor.x, poses[k, 1] - sensor.y
        reach = fan.reach + radii[k]
        if rx * rx + ry * ry > reach * reach:
            continue
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        for q in range(starts[k], starts[k + 1]):
            ax = rx + c * segments[q, 0] - s * segments[q, 1]
            ay = ry + s * segments[q, 0] + c * segments[q, 1]
            bx = ax + c * segments[q, 2] - s * segments[q, 3]
            by = ay + s * segments[q, 2] + c * segments[q, 3]
            _shorten(ax, ay, bx, by, sensor.yaw + fan.first, fan.increment, turn_beams, out)


@kernel
def measure(out: Array1[np.float64], noise: Array1[np.float64], reading: Reading) -> None:
    """Converts true distances to ranges in place: noise, limits.

    Args:
        out: distances [m].
        noise: standard normal samples, one per beam.
        reading: of the sensor.
    """
    mean, deviation, least, most = reading
    for i in range(out.shape[0]):
        true = out[i]
        if true >= most:
            out[i] = math.inf
        elif true < least:
            out[i] = -math.inf
        else:
            value = true + deviation * noise[i] + mean
            out[i] = min(max(value, least), most)
