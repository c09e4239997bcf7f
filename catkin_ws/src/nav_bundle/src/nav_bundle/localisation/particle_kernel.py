"""Particle filter kernels: KLD resampling, clustering, and random draws of cells.

The pose histogram has bins of ``BIN_LENGTH`` and 1 / ``HEADINGS`` of a turn. A bin's key packs its column, row and
heading into one integer. Keys are kept in a hash table with open addressing; its length is a power of two, at least
twice the number of particles.
"""

import math
from typing import NamedTuple

import numpy as np

from pioneer_kernels.declaration import Array1, Array2, kernel, njit

BIN_LENGTH = 0.5
"""Side of a bin [m]."""
HEADINGS = 36
"""Number of heading bins in a full turn."""
EMPTY = -1
OFFSET = 1 << 24


class Draws(NamedTuple):
    """Random draws for one resampling; ``most`` is the maximum number of particles."""

    cumulative: Array1[
        np.float64
    ]  #: cumulative sum of the particles' weights, ending at 1, shape (n,)
    uniforms: Array1[np.float64]  #: numbers in [0, 1), shape (most,)
    renew: Array1[
        np.uint8
    ]  #: if not 0, the particle is taken from ``fresh`` instead, shape (most,)
    fresh: Array2[np.float64]  #: random poses for those particles, shape (most, 3)


class Limits(NamedTuple):
    """Minimum number of particles, maximum error (kld_err), upper quantile of the standard normal (kld_z)."""

    least: int
    error: float
    quantile: float


@njit
def _key(x, y, yaw):
    """Returns the key of the bin that contains a pose; never negative."""
    turn = yaw / math.tau
    heading = min(HEADINGS - 1, np.int64((turn - math.floor(turn)) * HEADINGS))
    col = np.int64(math.floor(x / BIN_LENGTH)) + OFFSET
    row = np.int64(math.floor(y / BIN_LENGTH)) + OFFSET
    return (col * (2 * OFFSET) + row) * HEADINGS + heading


@njit
def _slot(key, table):
    """Returns the slot of ``key`` in the hash table, or the empty slot where it belongs."""
    mask = table.shape[0] - 1
    place = np.int64((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)) & mask
    while table[place] != EMPTY and table[place] != key:
        place = (place + 1) & mask
    return place


@njit
def _enough(bins, error, quantile):
    """Returns the number of particles that keeps the error of ``bins`` bins below ``error`` (Fox 2003, equation 7)."""
    if bins <= 1:
        return 0.0
    spread = 2.0 / (9.0 * (bins - 1))
    root = 1.0 - spread + math.sqrt(spread) * quantile
    return math.ceil((bins - 1) / (2.0 * error) * root * root * root)


@kernel
def resample(
    poses: Array2[np.float64],
    draws: Draws,
    limits: Limits,
    table: Array1[np.int64],
    out: Array2[np.float64],
) -> int:
    """Draws particles by weight until their number suffices for the occupied bins; returns that number.

    Args:
        poses: particles x, y [m], yaw [rad], shape (n, 3).
        draws: the random draws.
        limits: limits of the number of particles.
        table: scratch space for the hash table.
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
    cells: Array2[np.int8],
    value: int,
    until_row: Array1[np.int64],
    drawn: Array1[np.int64],
    out: Array2[np.int64],
) -> None:
    """Writes (row, col), shape (n, 2), of the cells with ``value`` whose indices, counted row by row, are ``drawn``.

    ``until_row`` is the cumulative number of such cells up to the end of each row.
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
    """Groups particles in adjacent bins (including diagonals and the wrap-around of the heading) into clusters.

    Args:
        poses: particles x, y [m], yaw [rad], shape (n, 3).
        weights: weights of the particles, shape (n,).
        table: scratch space for the hash table, same length as ``labels``.
        labels: scratch space for the cluster of each slot.
        sums: output, one row per cluster: count, weight, and the weighted sums of x, y, cos yaw, sin yaw, x², xy, y².
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
    """Assigns ``label`` to the bin at ``place`` and to all bins connected to it."""
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
