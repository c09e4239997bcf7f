"""Kernel that finds obstacles of a robot's size among marked cells."""

from typing import NamedTuple

import numpy as np

from pioneer_kernels.declaration import Array2, kernel, njit

Marks = Array2[np.uint8]
"""``[row, col]``; marked cells are not 0."""

_EXACT = 1.0e-6
"""Squared distances [cells**2] are whole numbers: limits that differ by less are equal to one."""


class Sizes(NamedTuple):
    """Distances between cells [cells]."""

    joined: float  #: cells less than this apart are on the same obstacle
    narrowest: float  #: a robot has two cells more than this apart ...
    widest: float  #: ... and at most this
    largest: float  #: an obstacle whose box has this diagonal, or a longer one, is no robot


@njit
def _half_width(limit, row, inclusive):
    """Returns the largest ``col`` whose distance from the origin is below ``limit`` in this row; -1 for none."""
    left = limit * limit - row * row + (_EXACT if inclusive else -_EXACT)
    return -1 if left < 0.0 else int(np.sqrt(left))


@njit
def _collect(marks, seen, row, col, joined, cells):
    """Stores the cells of the obstacle at (row, col) in ``cells`` and marks them in ``seen``; returns their number."""
    rows, cols = marks.shape
    reach = int(np.ceil(joined))
    cells[0, 0] = row
    cells[0, 1] = col
    seen[row, col] = 1
    count = 1
    done = 0
    while done < count:
        row = cells[done, 0]
        col = cells[done, 1]
        done += 1
        for other in range(max(row - reach, 0), min(row + reach + 1, rows)):
            width = _half_width(joined, other - row, False)
            for i in range(max(col - width, 0), min(col + width + 1, cols)):
                if marks[other, i] and not seen[other, i]:
                    seen[other, i] = 1
                    cells[count, 0] = other
                    cells[count, 1] = i
                    count += 1
    return count


@njit
def _diagonal(cells, count):
    """Returns the diagonal of the box around the first ``count`` cells."""
    row_0 = row_1 = cells[0, 0]
    col_0 = col_1 = cells[0, 1]
    for i in range(count):
        row_0 = min(row_0, cells[i, 0])
        row_1 = max(row_1, cells[i, 0])
        col_0 = min(col_0, cells[i, 1])
        col_1 = max(col_1, cells[i, 1])
    return np.hypot(float(row_1 - row_0), float(col_1 - col_0))


@njit
def _has_partner(before, row, col, sizes):
    """Returns whether a marked cell is between ``sizes.narrowest`` and ``sizes.widest`` away.

    ``before[row, col]`` is the number of marked cells in this row in the columns before ``col``.
    """
    rows, cols = before.shape
    cols -= 1
    reach = int(np.ceil(sizes.widest))
    for other in range(max(row - reach, 0), min(row + reach + 1, rows)):
        outer = _half_width(sizes.widest, other - row, True)
        if outer < 0:
            continue
        count = before[other, min(col + outer + 1, cols)] - before[other, max(col - outer, 0)]
        inner = _half_width(sizes.narrowest, other - row, True)
        if inner >= 0:
            count -= before[other, min(col + inner + 1, cols)] - before[other, max(col - inner, 0)]
        if count > 0:
            return True
    return False


@kernel
def keep_robot_sized(marks: Marks, sizes: Sizes) -> None:
    """Clears the marked cells that are on obstacles too large for a robot, or too narrow."""
    rows, cols = marks.shape
    before = np.zeros((rows, cols + 1), np.int32)
    total = 0
    for row in range(rows):
        for col in range(cols):
            before[row, col + 1] = before[row, col] + (1 if marks[row, col] else 0)
        total += before[row, cols]
    seen = np.zeros((rows, cols), np.uint8)
    kept = np.zeros((rows, cols), np.uint8)
    cells = np.empty((total, 2), np.int64)
    for row in range(rows):
        for col in range(cols):
            if not marks[row, col] or seen[row, col]:
                continue
            count = _collect(marks, seen, row, col, sizes.joined, cells)
            if _diagonal(cells, count) >= sizes.largest - _EXACT:
                continue
            for i in range(count):
                if _has_partner(before, cells[i, 0], cells[i, 1], sizes):
                    kept[cells[i, 0], cells[i, 1]] = 1
    marks[:] = kept
