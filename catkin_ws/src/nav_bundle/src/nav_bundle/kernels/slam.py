"""Maps in shared tiles, as mapping needs them: matching scans to them, registering scans in them, drawing them.

A map is a ``directory``: tile numbers, shape (tile rows, tile columns), -1 where nothing has been seen. Tiles hold
``TILE`` x ``TILE`` cells and lie in one ``pool``, uint16, shape (tiles, TILE * TILE, 4): visits, hits, and the mean
place of the hits within the cell in 65536ths of its side, x and y. Several maps may name one tile: it is copied when
one of them writes. ``placement`` is (x [m], y [m] of the corner of cell (0, 0); 1 / side of a cell [1/m]).

Beams are (cosine, sine of the bearing in the laser frame; length [cells]), shape (m, 3). Poses are the laser's.
"""

import math
from typing import NamedTuple

import numpy as np

from pioneer_kernels.declaration import Array1, Array2, Array3, kernel, njit

RELEASE_GIL = True
"""A match takes 30 to 300 ms; the thread that publishes tf must run meanwhile."""

BITS = 5
TILE = 1 << BITS
MASK = TILE - 1
VISITS, HITS, MEAN_X, MEAN_Y = 0, 1, 2, 3
MOST = 65535
FULL = 10
"""A cell counts as an obstacle where more than one visit in ``FULL`` was a hit."""
MISS = -0.5
"""What a beam adds to the likelihood that met no obstacle, over lsigma: far worse than any that did."""
SHIFT = 1 << 30


class Maps(NamedTuple):
    """The particles' maps: directories, shape (n, tile rows, tile columns), the pool of tiles, their placement."""

    directories: Array3[np.int32]
    pool: Array3[np.uint16]
    placement: Array1[np.float64]


class Matching(NamedTuple):
    """How scans are matched."""

    sigma: float  #: [m]
    lsigma: float  #: [m]
    lstep: float  #: first step along x and y [m]
    astep: float  #: first step of the heading [rad]
    least: float  #: a particle whose best score is no better stays where it was (minimumScore)
    iterations: int  #: halvings of the steps
    reach: int  #: cells about a beam's end in which an obstacle is looked for, along x and y (kernelSize)


class Tiles(NamedTuple):
    """The pool of tiles for writing."""

    pool: Array3[np.uint16]  #: the tiles
    users: Array1[np.int32]  #: how many maps name each tile
    spare: Array1[np.int32]  #: the number k of unused tiles, then their numbers, of which the k-th is taken first


@njit
def _floor(value):
    """Floor of a number above -2^30: a truncation, which needs no call."""
    return np.int64(value + SHIFT) - SHIFT


@njit
def _is_full(directory, pool, row, col):
    """Tells whether a cell is an obstacle; what was not seen is none."""
    tile_row, tile_col = row >> BITS, col >> BITS
    if tile_row < 0 or tile_col < 0 or tile_row >= directory.shape[0] or tile_col >= directory.shape[1]:
        return False
    tile = directory[tile_row, tile_col]
    if tile < 0:
        return False
    place = ((row & MASK) << BITS) | (col & MASK)
    return np.int64(pool[tile, place, HITS]) * FULL > np.int64(pool[tile, place, VISITS])


@njit
def _nearest(directory, pool, x, y, behind_row, behind_col, reach):
    """Squared distance [cells²] from (x, y) to the nearest obstacle's mean within ``reach`` cells; -1 without one.

    An obstacle counts only if one of its neighbours towards the laser, at ``behind_row`` or ``behind_col``, is none:
    walls are hit on their near side. (Upstream asks for the one cell along the beam, which in a corridor lies in the
    same wall: grazing beams then count for nothing, and the heading drifts.)
    """
    row, col = _floor(y), _floor(x)
    best = -1.0
    for r in range(row - reach, row + reach + 1):
        for c in range(col - reach, col + reach + 1):
            if not _is_full(directory, pool, r, c):
                continue
            if _is_full(directory, pool, r + behind_row, c) and _is_full(directory, pool, r, c + behind_col):
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
    """Sum over the beams of exp(-d² / sigma), which climbing needs, or of -d² / lsigma: the log likelihood."""
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
        square = _nearest(directory, maps.pool, end_x, end_y, behind_row, behind_col, matching.reach) * square_side
        if exponential:
            if square >= 0.0:
                total += math.exp(-square / matching.sigma)
        else:
            total += -square / matching.lsigma if square >= 0.0 else MISS / matching.lsigma
    return total


@njit
def _climb(pose, beams, directory, maps, matching):
    """Moves ``pose`` to where the beams score best nearby; returns that score.

    Each round tries a step along x, y and yaw both ways and takes the best; where none is better, steps are halved.
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
    poses: Array2[np.float64], beams: Array2[np.float64], maps: Maps, matching: Matching, out: Array2[np.float64]
) -> None:
    """Moves each particle to where the scan fits its map best, and weighs it there.

    Args:
        poses: particles x, y [m], yaw [rad], shape (n, 3); changed.
        beams: those that hit something.
        maps: of the particles.
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
    """Number of a tile that this map alone names: the one there, or a copy of it, or an empty one."""
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
    """Counts a beam through or into a cell; full counts are halved, which keeps their ratio."""
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
    """Enters a scan into one map: cells along each beam are visited (Bresenham's line), its end is hit.

    Args:
        pose: of the laser, shape (3,).
        beams: those to enter; none may lead out of the directory.
        hits: where 0, the beam ended in the air: its last cell is visited as the others, shape (m,).
        placement: of the map.
        directory: the map's, changed.
        tiles: changed; there must be an unused one for each that the scan touches.
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
    """Writes a map's cells: 100 where more than ``threshold`` of the visits were hits, 0 where not; unseen ones stay.

    Args:
        directory: the map's.
        pool: of the tiles.
        threshold: 0 … 1.
        first_row: row in ``out`` of the directory's first cell, negative where ``out`` begins later.
        first_col: its column.
        out: cells; those beyond it are left out.
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
