"""Navigation function: a potential that propagates from the robot over the costmap, and the descent along it.

The potential of a cell is the cost of the cheapest path from the source, weighted by the cells' costs. It is computed
as a planar wave from the cell's neighbours (Brock and Khatib, 1999; the quadratic approximation is navfn's). The
wavefront is kept in three buffers by priority, not in a heap. Its whole state is in arrays, so that one search can be
spread over many calls.

A guide is a heuristic for the remaining cost: the potential of another wave, which ran from the goal over a grid of
blocks of ``BLOCK`` x ``BLOCK`` cells, surrounded by a ring of blocked blocks.
"""

from typing import NamedTuple

import numpy as np

from pioneer_kernels.declaration import Array1, Array2, kernel, njit

FAR = 1.0e10
"""The potential of a cell that was not reached."""

# Indices into ``counts`` and ``limits``.
NOW, NEXT, LATER, BEYOND = 0, 1, 2, 3
LIMIT, STEP, BOUND, EXCESS = 0, 1, 2, 3
RUNNING, DONE, FULL = 0, 1, 2
BLOCK_BITS = 2
BLOCK = 1 << BLOCK_BITS

Cell = tuple[int, int]
"""Row and column."""


class Front(NamedTuple):
    """The state of a wave over a grid."""

    potential: Array2[np.float32]  #: potentials of the cells, shape (rows, cols)
    waiting: Array2[np.uint8]  #: 1 for cells that wait in a buffer
    costs: Array2[np.uint8]  #: costs of the cells
    weights: Array1[
        np.float32
    ]  #: potential added by a cell of each cost, negative if blocked, shape (256,)
    queue: Array2[np.int32]  #: the buffers, shape (4, capacity)
    counts: Array1[np.int64]  #: number of cells in each buffer
    limits: Array1[
        np.float64
    ]  #: limit of final potentials, its step, bound of a guided wave, and its step


@njit
def _offer(queue, counts, which, waiting, weights, costs, cell, potential, value):
    """Appends a cell to a buffer if it is traversable, its potential can improve, and it is not waiting already."""
    if waiting[cell] != 0:
        return
    weight = weights[costs[cell]]
    if weight >= 0.0 and potential > value + np.float32(0.7) * weight:
        waiting[cell] = 1
        queue[which, counts[which]] = cell
        counts[which] += 1


@kernel
def begin(front: Front, start: Cell) -> None:
    """Resets the search, with its source at ``start``.

    Cells at the edge of the grid are marked as waiting permanently, so that other cells need no bounds checks.
    """
    potential, waiting, costs, weights, queue, counts, limits = front
    row, col = start
    rows, cols = potential.shape
    potential[:, :] = FAR
    waiting[:, :] = 0
    waiting[0, :] = 1
    waiting[rows - 1, :] = 1
    waiting[:, 0] = 1
    waiting[:, cols - 1] = 1
    counts[:] = 0
    potential[row, col] = 0.0
    limits[LIMIT] = limits[STEP]
    source = row * cols + col
    for cell in (source + 1, source - 1, source + cols, source - cols):
        if 0 <= cell < potential.size:
            _offer(queue, counts, NOW, waiting.ravel(), weights, costs.ravel(), cell, FAR, 0.0)


@njit
def _wave(across, along, weight):
    """Returns a cell's potential from its neighbours': a planar wave if both axes contribute, else a straight step."""
    low = min(across, along)
    gap = abs(across - along)
    if gap >= weight:
        return low + weight
    d = gap / weight
    return low + weight * (
        np.float32(-0.2301) * d * d + np.float32(0.5307) * d + np.float32(0.7040)
    )


@kernel
def spread(front: Front, goal: Cell, guide: Array2[np.float32], budget: int) -> int:
    """Propagates the wave over about ``budget`` cells; returns 0 running, 1 done, 2 buffers too small.

    Done means that the goal's potential is final or that no cells are left. With a non-empty guide, cells are deferred
    if the guide's estimate of the total path through them exceeds a bound. Whenever the goal is not reached within the
    bound, it is raised, each time by twice as much (iterative A*).
    """
    potential, waiting, costs, weights, queue, counts, limits = front
    goal_row, goal_col = goal
    cols = potential.shape[1]
    per_col = 1.0 / cols
    guided = guide.size > 0
    field = potential.ravel()
    waits = waiting.ravel()
    cost = costs.ravel()
    capacity = queue.shape[1]
    while budget > 0:
        if counts[NOW] == 0:
            if potential[goal_row, goal_col] < limits[LIMIT]:
                return DONE
            limits[LIMIT] += limits[STEP]
            following = LATER
            if counts[LATER] == 0:
                if not guided or counts[BEYOND] == 0 or potential[goal_row, goal_col] < FAR:
                    return DONE
                limits[BOUND] += limits[EXCESS]
                limits[EXCESS] *= 2.0
                following = BEYOND
            queue[NOW, : counts[following]] = queue[following, : counts[following]]
            counts[NOW] = counts[following]
            counts[following] = 0
        count = counts[NOW]
        if counts[LATER] + 4 * count > capacity or (guided and counts[BEYOND] + count > capacity):
            return FULL
        for i in range(count):
            cell = queue[NOW, i]
            waits[cell] = 0
            right = field[cell + 1]
            left = field[cell - 1]
            above = field[cell + cols]
            below = field[cell - cols]
            value = _wave(min(left, right), min(above, below), weights[cost[cell]])
            if value >= field[cell]:
                continue
            if guided:
                row = np.int64(
                    (cell + 0.5) * per_col
                )  # integer division would be slower than the rest of this block
                col = cell - row * cols
                if value + guide[(row >> BLOCK_BITS) + 1, (col >> BLOCK_BITS) + 1] > limits[BOUND]:
                    queue[BEYOND, counts[BEYOND]] = cell
                    counts[BEYOND] += 1
                    continue
            field[cell] = value
            which = NEXT if value < limits[LIMIT] else LATER
            _offer(queue, counts, which, waits, weights, cost, cell + 1, right, value)
            _offer(queue, counts, which, waits, weights, cost, cell - 1, left, value)
            _offer(queue, counts, which, waits, weights, cost, cell + cols, above, value)
            _offer(queue, counts, which, waits, weights, cost, cell - cols, below, value)
        budget -= count
        queue[NOW, : counts[NEXT]] = queue[NEXT, : counts[NEXT]]
        counts[NOW] = counts[NEXT]
        counts[NEXT] = 0
    return RUNNING


_ONE, _NONE = np.uint32(1 << 16), np.uint32(0xFFFFFFFF)


@njit
def _block_weight(costs, table, first_row, first_col, rows, cols):
    """Returns the average of the lowest and the mean weight of the traversable cells; 0 if there are none."""
    total = np.uint32(0)
    least = _NONE
    for row in range(rows):
        for col in range(cols):
            entry = table[costs[first_row + row, first_col + col]]
            total += entry
            least = min(
                least, np.uint32(entry - _ONE)
            )  # blocked cells wrap around to more than any weight
    if total < _ONE:
        return np.uint8(0)
    mean = np.float32(total & np.uint32(0xFFFF)) / np.float32(total >> np.uint32(16))
    return np.uint8(np.float32(0.5) * (np.float32(least) + mean))


@kernel
def coarsen(costs: Array2[np.uint8], weights: Array1[np.float32], coarse: Array2[np.uint8]) -> None:
    """Writes the weight per cell of each block into ``coarse``, shape (block rows + 2, block columns + 2) with ring.

    The weight is the average of the lowest and the mean weight of the block's cells, since paths prefer cheap cells.
    Only traversable cells count; a block without any is left unchanged. No passage is lost, but a wall thinner than
    twice ``BLOCK`` cells may have gaps.
    """
    rows, cols = costs.shape
    # The weight by cell cost, plus bit 16 if the cell is traversable, so that one sum yields total weight and count.
    table = np.zeros(256, np.uint32)
    for cost in range(256):
        if weights[cost] >= 0.0:
            table[cost] = np.uint32(weights[cost]) | _ONE
    whole_rows, whole_cols = rows >> BLOCK_BITS, cols >> BLOCK_BITS
    for block_row in range(coarse.shape[0] - 2):
        row = block_row << BLOCK_BITS
        for block_col in range(coarse.shape[1] - 2):
            col = block_col << BLOCK_BITS
            if block_row < whole_rows and block_col < whole_cols:
                weight = _block_weight(
                    costs, table, row, col, BLOCK, BLOCK
                )  # fixed size, so that loops are unrolled
            else:
                weight = _block_weight(
                    costs, table, row, col, min(BLOCK, rows - row), min(BLOCK, cols - col)
                )
            if weight > 0:
                coarse[block_row + 1, block_col + 1] = weight


@njit
def _slope(potential, row, col, d_row, d_col):
    """Returns the slope of the potential, positive downhill, in direction ``d_row, d_col``, from reached neighbours."""
    here = potential[row, col]
    if here >= FAR:
        return 0.0
    ahead = potential[row + d_row, col + d_col]
    behind = potential[row - d_row, col - d_col]
    fall = 0.0
    if ahead < FAR:
        fall += here - ahead
    if behind < FAR:
        fall += behind - here
    return fall


@njit
def _downhill(potential, y, x):
    """Returns the unit direction (row, col) of steepest descent at a point; zero if there is none.

    Interpolates bilinearly between the slopes of the four surrounding cells; the point is in cells, with cell centres
    at integers.
    """
    rows, cols = potential.shape
    row = int(np.floor(y))
    col = int(np.floor(x))
    if row < 1 or row > rows - 3 or col < 1 or col > cols - 3:
        return 0.0, 0.0
    fy = y - row
    fx = x - col
    down = 0.0
    right = 0.0
    for i in range(2):
        for j in range(2):
            share = (fy if i else 1.0 - fy) * (fx if j else 1.0 - fx)
            a = _slope(potential, row + i, col + j, 1, 0)
            b = _slope(potential, row + i, col + j, 0, 1)
            length = np.sqrt(a * a + b * b)
            if length > 0.0:
                down += share * a / length
                right += share * b / length
    length = np.sqrt(down * down + right * right)
    if length < 1.0e-6:
        return 0.0, 0.0
    return down / length, right / length


@njit
def _lowest_neighbour(potential, row, col):
    """Returns the lowest of the eight neighbours, or the cell itself if none is lower."""
    rows, cols = potential.shape
    best_row, best_col, best = row, col, potential[row, col]
    for d_row in range(-1, 2):
        for d_col in range(-1, 2):
            r = row + d_row
            c = col + d_col
            if 0 <= r < rows and 0 <= c < cols and potential[r, c] < best:
                best_row, best_col, best = r, c, potential[r, c]
    return best_row, best_col


@njit
def _all_reached(potential, row, col):
    rows, cols = potential.shape
    if row < 1 or row > rows - 2 or col < 1 or col > cols - 2:
        return False
    for r in range(row - 1, row + 2):
        for c in range(col - 1, col + 2):
            if potential[r, c] >= FAR:
                return False
    return True


@kernel
def descend(
    potential: Array2[np.float32], path: Array2[np.float64], end: Cell, source: Cell
) -> int:
    """Descends the gradient from ``end`` to ``source`` in steps of half a cell.

    Next to cells that were not reached, and where the interpolated slope does not lead down, it steps from cell to
    cell instead. Writes (row, col) [cells] into ``path``; returns the number of points, 0 if it got stuck or ``path``
    is too short.
    """
    row, col = end
    source_row, source_col = source
    y = float(row)
    x = float(col)
    lowest = potential[row, col] + 1.0
    idle = 0
    for count in range(path.shape[0] - 1):
        path[count, 0] = y
        path[count, 1] = x
        if abs(y - source_row) <= 1.0 and abs(x - source_col) <= 1.0:
            path[count + 1, 0] = source_row
            path[count + 1, 1] = source_col
            return count + 2
        r = int(np.floor(y + 0.5))
        c = int(np.floor(x + 0.5))
        here = potential[r, c]
        if here < lowest:
            lowest = here
            idle = 0
        else:
            idle += 1
        down, right = 0.0, 0.0
        if idle < 4 and _all_reached(potential, r, c):
            down, right = _downhill(potential, y, x)
        if down != 0.0 or right != 0.0:
            y += 0.5 * down
            x += 0.5 * right
            continue
        next_row, next_col = _lowest_neighbour(potential, r, c)
        if next_row == r and next_col == c:
            return 0
        y = float(next_row)
        x = float(next_col)
        idle = 0
        lowest = potential[next_row, next_col] + 1.0
    return 0


@kernel
def descend_cells(
    potential: Array2[np.float32], path: Array2[np.float64], end: Cell, source: Cell
) -> int:
    """Descends from ``end`` to ``source``, always to the lowest of the eight neighbours.

    Writes (row, col) [cells] into ``path``; returns the number of cells, 0 if it got stuck.
    """
    row, col = end
    source_row, source_col = source
    for count in range(path.shape[0]):
        path[count, 0] = row
        path[count, 1] = col
        if row == source_row and col == source_col:
            return count + 1
        next_row, next_col = _lowest_neighbour(potential, row, col)
        if next_row == row and next_col == col:
            return 0
        row, col = next_row, next_col
    return 0


@kernel
def nearest_reached(potential: Array2[np.float32], goal: Cell, tolerance: float) -> int:
    """Returns the flat index of the reached cell nearest to ``goal`` within ``tolerance`` [cells]; -1 if none."""
    row, col = goal
    rows, cols = potential.shape
    reach = int(np.ceil(tolerance))
    best = -1
    best_distance = tolerance * tolerance + 1.0e-9
    for r in range(max(row - reach, 0), min(row + reach + 1, rows)):
        for c in range(max(col - reach, 0), min(col + reach + 1, cols)):
            distance = float((r - row) * (r - row) + (c - col) * (c - col))
            if potential[r, c] < FAR and (
                distance < best_distance or (best < 0 and distance <= best_distance)
            ):
                best = r * cols + c
                best_distance = distance
    return best
