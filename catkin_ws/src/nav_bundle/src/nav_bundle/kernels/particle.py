"""Resampling of particles whose number follows the spread of their histogram, its clusters, and draws of cells.

The histogram has bins of ``BINS``; a bin's key packs its column, row and heading into one integer, kept in a hash
table with open addressing whose length is a power of two at least twice the number of particles.
"""

import math
from typing import NamedTuple

import numpy as np

from pioneer_kernels.declaration import Array1, Array2, kernel, njit

BIN_LENGTH = 0.5
"""Side of a bin [m]."""
HEADINGS = 36
"""Bins of heading in a turn."""
EMPTY = -1
OFFSET = 1 << 24


class Draws(NamedTuple):
    """The chances of one resampling; ``most`` is the largest number of particles."""

    cumulative: Array1[np.float64]  #: running sum of the particles' weights, ending at 1, shape (n,)
    uniforms: Array1[np.float64]  #: from [0, 1), shape (most,)
    renew: Array1[np.uint8]  #: where not 0, the particle comes from ``fresh`` instead, shape (most,)
    fresh: Array2[np.float64]  #: poses for those, shape (most, 3)


class Limits(NamedTuple):
    """Smallest number of particles, greatest error (kld_err), upper quantile of the standard normal (kld_z)."""

    least: int
    error: float
    quantile: float


@njit
def _key(x, y, yaw):
    """Key of the bin that holds a pose; never negative."""
    turn = yaw / math.tau
    heading = min(HEADINGS - 1, np.int64((turn - math.floor(turn)) * HEADINGS))
    col = np.int64(math.floor(x / BIN_LENGTH)) + OFFSET
    row = np.int64(math.floor(y / BIN_LENGTH)) + OFFSET
    return (col * (2 * OFFSET) + row) * HEADINGS + heading


@njit
def _slot(key, table):
    """Place of ``key`` in the hash table, or the empty place where it belongs."""
    mask = table.shape[0] - 1
    place = np.int64((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)) & mask
    while table[place] != EMPTY and table[place] != key:
        place = (place + 1) & mask
    return place


@njit
def _enough(bins, error, quantile):
    """Particles that keep the error of ``bins`` occupied bins below ``error`` (Fox 2003, equation 7)."""
    if bins <= 1:
        return 0.0
    spread = 2.0 / (9.0 * (bins - 1))
    root = 1.0 - spread + math.sqrt(spread) * quantile
    return math.ceil((bins - 1) / (2.0 * error) * root * root * root)


@kernel
def resample(
    poses: Array2[np.float64], draws: Draws, limits: Limits, table: Array1[np.int64], out: Array2[np.float64]
) -> int:
    """Draws particles by weight until their number suffices for the bins they fill; returns that number.

    Args:
        poses: particles x, y [m], yaw [rad], shape (n, 3).
        draws: which of them to take.
        limits: of their number.
        table: room for the hash table.
        out: the particles drawn, shape (most, 3).
    """
    table[:] = EMPTY
    most = out.shape[0]
    bins = 0
    wanted = 0.0
    for count in range(most):
        if draws.renew[count]:
            out[count] = draws.fresh[count]
        else:
            drawn = np.searchsorted(draws.cumulative, draws.uniforms[count], side="right")
            out[count] = poses[min(drawn, poses.shape[0] - 1)]
        key = _key(out[count, 0], out[count, 1], out[count, 2])
        place = _slot(key, table)
        if table[place] == EMPTY:
            table[place] = key
            bins += 1
            wanted = _enough(bins, limits.error, limits.quantile)
        if count + 1 >= max(wanted, limits.least):
            return count + 1
    return most


@kernel
def find_cells(
    cells: Array2[np.int8], value: int, until_row: Array1[np.int64], drawn: Array1[np.int64], out: Array2[np.int64]
) -> None:
    """Writes (row, col), shape (n, 2), of the cells of ``value`` whose numbers, row by row from 0, are ``drawn``.

    ``until_row`` has for each row how many such cells there are up to its end.
    """
    for index in range(drawn.shape[0]):
        row = np.searchsorted(until_row, drawn[index], side="right")
        left = drawn[index] - (until_row[row - 1] if row > 0 else 0)
        col = 0
        while left > 0 or cells[row, col] != value:
            if cells[row, col] == value:
                left -= 1
            col += 1
        out[index, 0], out[index, 1] = row, col


@kernel
def cluster(
    poses: Array2[np.float64],
    weights: Array1[np.float64],
    table: Array1[np.int64],
    labels: Array1[np.int64],
    sums: Array2[np.float64],
) -> int:
    """Joins particles whose bins touch (also at edges and corners, and over the turn of heading) into clusters.

    Args:
        poses: particles x, y [m], yaw [rad], shape (n, 3).
        weights: of the particles, shape (n,).
        table: room for the hash table, as long as ``labels``.
        labels: room for the clusters of its places.
        sums: one row a cluster, written: count, weight, and the weighted sums of x, y, cos yaw, sin yaw, x², xy, y².
            As many rows as particles suffice.

    Returns:
        The number of clusters.
    """
    table[:] = EMPTY
    labels[:] = EMPTY
    for index in range(poses.shape[0]):
        key = _key(poses[index, 0], poses[index, 1], poses[index, 2])
        table[_slot(key, table)] = key
    count = 0
    stack = np.empty(poses.shape[0], np.int64)
    for place in range(table.shape[0]):
        if table[place] != EMPTY and labels[place] == EMPTY:
            _flood(place, count, table, labels, stack)
            count += 1
    sums[:count] = 0.0
    for index in range(poses.shape[0]):
        x, y, yaw = poses[index, 0], poses[index, 1], poses[index, 2]
        weight = weights[index]
        row = sums[labels[_slot(_key(x, y, yaw), table)]]
        row[0] += 1.0
        row[1] += weight
        row[2] += weight * x
        row[3] += weight * y
        row[4] += weight * math.cos(yaw)
        row[5] += weight * math.sin(yaw)
        row[6] += weight * x * x
        row[7] += weight * x * y
        row[8] += weight * y * y
    return count


@njit
def _flood(place, label, table, labels, stack):
    """Gives ``label`` to the bin at ``place`` and to all that hang together with it."""
    labels[place] = label
    stack[0] = place
    height = 1
    while height > 0:
        height -= 1
        key = table[stack[height]]
        heading = key % HEADINGS
        plane = key // HEADINGS
        for across in range(-1, 2):
            for along in range(-1, 2):
                for turn in range(-1, 2):
                    neighbour = plane + across * (2 * OFFSET) + along
                    other = _slot(neighbour * HEADINGS + (heading + turn) % HEADINGS, table)
                    if table[other] != EMPTY and labels[other] == EMPTY:
                        labels[other] = label
                        stack[height] = other
                        height += 1
