"""SLAM kernels for maps in shared tiles: scan matching, registering scans, drawing maps.

A map is a ``directory``: tile numbers, shape (tile rows, tile columns), -1 for tiles without observations. Tiles hold
``TILE`` x ``TILE`` cells and are in one ``pool``, uint16, shape (tiles, TILE * TILE, 4): visits, hits, and the mean
position of the hits within the cell, x and y, in 65536ths of its side. Several maps may share a tile; it is copied
when one of them writes. ``placement`` is (x [m], y [m] of the corner of cell (0, 0); 1 / cell size [1/m]).

Beams are (cosine, sine of the bearing in the laser frame; length [cells]), shape (m, 3). Poses are the laser's.
"""

import math
from typing import NamedTuple

import numpy as np

from pioneer_kernels.declaration import Array1, Array2, Array3, kernel, njit

RELEASE_GIL = True
"""A match takes 30 to 300 ms; the thread that publishes tf must keep running during this time."""

BITS = 5
TILE = 1 << BITS
MASK = TILE - 1
VISITS, HITS, MEAN_X, MEAN_Y = 0, 1, 2, 3
MOST = 65535
FULL = 10
"""A cell counts as an obstacle if more than one in ``FULL`` visits was a hit."""
MISS = -0.5
"""Log likelihood, times lsigma, of a beam without an obstacle nearby: far lower than that of any beam with one."""
SHIFT = 1 << 30


class Maps(NamedTuple):
    """The particles' maps: directories, shape (n, tile rows, tile columns), the pool of tiles, their placement."""

    directories: Array3[np.int32]
    pool: Array3[np.uint16]
    placement: Array1[np.float64]


class Matching(NamedTuple):
    """Parameters of scan matching."""

    sigma: float  #: spread in the matching score [m]
    lsigma: float  #: spread in the log likelihood [m]
    lstep: float  #: initial step along x and y [m]
    astep: float  #: initial step of the heading [rad]
    least: float  #: a particle whose best score does not exceed this keeps its pose (minimumScore)
    iterations: int  #: number of times the steps are halved
    reach: (
        int  #: search range [cells] for an obstacle around a beam's end, along x and y (kernelSize)
    )


class Tiles(NamedTuple):
    """The pool of tiles for writing."""

    pool: Array3[np.uint16]  #: the tiles
    users: Array1[np.int32]  #: number of maps that use each tile
    spare: Array1[np.int32]  #: count k of unused tiles, then their numbers; the k-th is taken first


@njit
def _floor(value):
    """Returns the floor of a number above -2^30 by truncation, which avoids a function call."""
    return np.int64(value + SHIFT) - SHIFT


@njit
def _is_full(directory, pool, row, col):
    """Returns whether a cell is an obstacle; unseen cells are not."""
    tile_row, tile_col = row >> BITS, col >> BITS
    if (
        tile_row < 0
        or tile_col < 0
        or tile_row >= directory.shape[0]
        or tile_col >= directory.shape[1]
    ):
        return False
    tile = directory[tile_row, tile_col]
    if tile < 0:
        return False
    place = ((row & MASK) << BITS) | (col & MASK)
    return np.int64(pool[tile, place, HITS]) * FULL > np.int64(pool[tile, place, VISITS])


@njit
def _nearest(directory, pool, x, y, behind_row, behind_col, reach):
    """Returns the squared distance [cells²] from (x, y) to the nearest obstacle's mean within ``reach`` cells, else -1.

    An obstacle counts only if a neighbour towards the laser, at ``behind_row`` or ``behind_col``, is not an obstacle,
    since walls are hit on their near side. (gmapping checks only the one cell along the beam. In a corridor this cell
    belongs to the same wall, so that grazing beams are ignored and the heading drifts.)
    """
    row, col = _floor(y), _floor(x)
    best = -1.0
    for r in range(row - reach, row + reach + 1):
        for c in range(col - reach, col + reach + 1):
            if not _is_full(directory, pool, r, c):
                continue
            if _is_full(directory, pool, r + behind_row, c) and _is_full(
                directory, pool, r, c + behind_col
            ):
                continue
            tile = directory[r >> BITS, c >> BITS]
            place = ((r & MASK) << BITS) | (c & MASK)
            dx = c + (pool[tile, place, MEAN_X] + 0.5) / (MOST + 1) - x
            dy = r + (pool[tile, place, MEAN_Y] + 0.5) / (MOST + 1) - y
            square = dx * dx + dy * dy
            if best < 0.0 or square < best:
                best = square
    return best


@njit
def _judge(x, y, yaw, beams, directory, maps, matching, exponential):
    """Returns the sum over the beams of exp(-d² / sigma) (matching score) or of -d² / lsigma (log likelihood)."""
    cosine, sine = math.cos(yaw), math.sin(yaw)
    placement = maps.placement
    left, low = (x - placement[0]) * placement[2], (y - placement[1]) * placement[2]
    square_side = 1.0 / (placement[2] * placement[2])
    total = 0.0
    for beam in range(beams.shape[0]):
        dx = cosine * beams[beam, 0] - sine * beams[beam, 1]
        dy = sine * beams[beam, 0] + cosine * beams[beam, 1]
        behind_row, behind_col = (-1 if dy > 0.0 else 1), (-1 if dx > 0.0 else 1)
        end_x, end_y = left + beams[beam, 2] * dx, low + beams[beam, 2] * dy
        square = (
            _nearest(directory, maps.pool, end_x, end_y, behind_row, behind_col, matching.reach)
            * square_side
        )
        if exponential:
            if square >= 0.0:
                total += math.exp(-square / matching.sigma)
        else:
            total += -square / matching.lsigma if square >= 0.0 else MISS / matching.lsigma
    return total


@njit
def _climb(pose, beams, directory, maps, matching):
    """Hill climbing: moves ``pose`` to the best score nearby; returns that score.

    Each round tries a step along x, y and yaw in both directions and takes the best; if none improves the score, the
    steps are halved.
    """
    length, turn = matching.lstep, matching.astep
    score = _judge(pose[0], pose[1], pose[2], beams, directory, maps, matching, True)
    halvings = 0
    while halvings <= matching.iterations:
        better, axis, move = score, -1, 0.0
        for trial in range(6):
            step = (turn if trial >= 4 else length) * (1.0 if trial % 2 == 0 else -1.0)
            x = pose[0] + (step if trial < 2 else 0.0)
            y = pose[1] + (step if trial == 2 or trial == 3 else 0.0)
            yaw = pose[2] + (step if trial >= 4 else 0.0)
            value = _judge(x, y, yaw, beams, directory, maps, matching, True)
            if value > better:
                better, axis, move = value, trial // 2, step
        if axis < 0:
            halvings += 1
            length, turn = 0.5 * length, 0.5 * turn
        else:
            score = better
            pose[axis] += move
    return score


@kernel
def match(
    poses: Array2[np.float64],
    beams: Array2[np.float64],
    maps: Maps,
    matching: Matching,
    out: Array2[np.float64],
) -> None:
    """Moves each particle to the pose where the scan fits its map best, and computes its likelihood there.

    Args:
        poses: particles x, y [m], yaw [rad], shape (n, 3); modified in place.
        beams: beams with a return.
        maps: the particles' maps.
        matching: parameters.
        out: score and log likelihood of each particle, shape (n, 2).
    """
    pose = np.empty(3)
    for index in range(poses.shape[0]):
        pose[:] = poses[index]
        directory = maps.directories[index]
        out[index, 0] = _climb(pose, beams, directory, maps, matching)
        if out[index, 0] > matching.least:
            poses[index] = pose
        x, y, yaw = poses[index, 0], poses[index, 1], poses[index, 2]
        out[index, 1] = _judge(x, y, yaw, beams, directory, maps, matching, False)


@njit
def _own_tile(directory, tile_row, tile_col, tiles):
    """Returns the number of a tile that only this map uses: the current one, a copy of a shared one, or a new one."""
    pool, users, spare = tiles
    tile = directory[tile_row, tile_col]
    if tile >= 0 and users[tile] == 1:
        return tile
    new = spare[spare[0]]
    spare[0] -= 1
    if tile >= 0:
        pool[new] = pool[tile]
        users[tile] -= 1
    else:
        pool[new] = 0
    users[new] = 1
    directory[tile_row, tile_col] = new
    return new


@njit
def _visit(pool, tile, place):
    """Counts a beam through or into a cell; saturated counts are halved, which keeps their ratio."""
    if pool[tile, place, VISITS] == MOST:
        pool[tile, place, VISITS] >>= 1
        pool[tile, place, HITS] >>= 1
    pool[tile, place, VISITS] += 1


@njit
def _hit(pool, tile, place, x, y):
    """Counts a beam that ended at (x, y) within a cell, 0 … 1."""
    _visit(pool, tile, place)
    hits = np.int64(pool[tile, place, HITS]) + 1
    pool[tile, place, HITS] = hits
    for axis, offset in ((MEAN_X, x), (MEAN_Y, y)):
        mean = np.float64(pool[tile, place, axis])
        mean += (offset * (MOST + 1) - 0.5 - mean) / hits
        pool[tile, place, axis] = np.uint16(min(max(mean + 0.5, 0.0), float(MOST)))


@kernel
def register(
    pose: Array1[np.float64],
    beams: Array2[np.float64],
    hits: Array1[np.uint8],
    placement: Array1[np.float64],
    directory: Array2[np.int32],
    tiles: Tiles,
) -> None:
    """Adds a scan to one map: counts visits of the cells along each beam (Bresenham's line) and a hit at its end.

    Args:
        pose: pose of the laser, shape (3,).
        beams: beams to add; none may leave the directory.
        hits: 0 for beams that end in free space, whose last cell is only visited, shape (m,).
        placement: placement of the map.
        directory: the map's directory; modified.
        tiles: the pool; modified. There must be one unused tile for each tile that the scan touches.
    """
    pool = tiles.pool
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    left, low = (pose[0] - placement[0]) * placement[2], (pose[1] - placement[1]) * placement[2]
    for beam in range(beams.shape[0]):
        end_x = left + beams[beam, 2] * (cosine * beams[beam, 0] - sine * beams[beam, 1])
        end_y = low + beams[beam, 2] * (sine * beams[beam, 0] + cosine * beams[beam, 1])
        row, col, end_row, end_col = _floor(low), _floor(left), _floor(end_y), _floor(end_x)
        rows, cols = abs(end_row - row), abs(end_col - col)
        step_row, step_col = (1 if end_row > row else -1), (1 if end_col > col else -1)
        lead = cols - rows
        tile, tile_row, tile_col = -1, -1, -1
        while True:
            if row >> BITS != tile_row or col >> BITS != tile_col:
                tile_row, tile_col = row >> BITS, col >> BITS
                tile = _own_tile(directory, tile_row, tile_col, tiles)
            place = ((row & MASK) << BITS) | (col & MASK)
            if row == end_row and col == end_col:
                break
            _visit(pool, tile, place)
            double = 2 * lead
            if double > -rows:
                lead -= rows
                col += step_col
            if double < cols:
                lead += cols
                row += step_row
        if hits[beam]:
            _hit(pool, tile, place, end_x - end_col, end_y - end_row)
        else:
            _visit(pool, tile, place)


@kernel
def draw(
    directory: Array2[np.int32],
    pool: Array3[np.uint16],
    threshold: float,
    first_row: int,
    first_col: int,
    out: Array2[np.int8],
) -> None:
    """Writes a map's visited cells: 100 if the share of hits among the visits exceeds ``threshold``, else 0.

    Args:
        directory: the map's directory.
        pool: the tiles.
        threshold: 0 … 1.
        first_row: row in ``out`` of the directory's first cell; negative if that cell is outside ``out``.
        first_col: its column in ``out``.
        out: cells; unvisited ones are not written, and cells outside ``out`` are skipped.
    """
    for tile_row in range(directory.shape[0]):
        for tile_col in range(directory.shape[1]):
            tile = directory[tile_row, tile_col]
            if tile < 0:
                continue
            for place in range(TILE * TILE):
                visits = pool[tile, place, VISITS]
                row = first_row + (tile_row << BITS) + (place >> BITS)
                col = first_col + (tile_col << BITS) + (place & MASK)
                if visits == 0 or row < 0 or col < 0 or row >= out.shape[0] or col >= out.shape[1]:
                    continue
                out[row, col] = 100 if pool[tile, place, HITS] > threshold * visits else 0
