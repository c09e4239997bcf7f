"""A wave of cost that spreads over a grid, and a guide that makes it hurry towards its goal."""

import numpy as np
from numpy.typing import NDArray

from nav_bundle.kernels.navfn import BLOCK, DONE, FULL, Cell, Front, begin, coarsen, spread

# A guided wave stays where the whole way is at most this many bands longer than the guide says, at first: as much as
# blocks at both ends can be wrong by, in tests with pillars.
_EXCESS = 4.0
# Blocks have no costs but what they add, up to 253.
_CLOSED = 255
_BLOCK_WEIGHTS = np.append(np.arange(_CLOSED) * float(BLOCK), -1.0).astype(np.float32)
_NO_GUIDE = np.empty((0, 0), np.float32)


class Wave:
    """A wave from ``source`` over ``costs``, uint8, shape (rows, cols), which it keeps.

    Args:
        costs: of the cells.
        weights: what crossing a cell of each cost adds, negative where nothing may pass, float32, shape (256,).
        source: row and column where it begins.
        band: how far apart its bands of urgency lie; what lies within one is visited in any order.
    """

    def __init__(self, costs: NDArray[np.uint8], weights: NDArray[np.float32], source: Cell, band: float) -> None:
        self._guide = _NO_GUIDE
        #: float32, shape (rows, cols): cost of the cheapest way from the source, ``FAR`` where none was found
        self.potential: NDArray[np.float32] = np.empty(costs.shape, np.float32)
        self._limits = np.array([0.0, band, 0.0, 0.0])
        self._front = Front(
            self.potential,
            np.empty(costs.shape, np.uint8),
            costs,
            weights,
            np.empty((4, 4096 + 16 * sum(costs.shape)), np.int32),
            np.zeros(4, np.int64),
            self._limits,
        )
        begin(self._front, source)

    @property
    def limit(self) -> float:
        """Up to here the potential is final, of a wave without a guide."""
        return float(self._limits[0])

    def follow(self, guide: NDArray[np.float32], ahead: float) -> None:
        """Goes by ``guide`` from now on; ``ahead`` is its potential at the source."""
        self._guide = guide
        excess = _EXCESS * self._limits[1]
        self._limits[2:] = ahead + excess, excess

    def advance(self, goal: Cell, budget: int) -> bool:
        """Visits about ``budget`` cells; returns whether ``goal`` has its potential, or nothing is left to visit."""
        while (status := spread(self._front, goal, self._guide, budget)) == FULL:
            queue = self._front.queue
            self._front = self._front._replace(queue=np.concatenate([queue, np.empty_like(queue)], axis=1))
        return status == DONE


class Guide:
    """About what is left of the way to ``goal`` from anywhere: the potential of a wave from there over blocks of cells.

    It is right to some hundredths where walls are thicker than two blocks, or than one with what inflation bars on both
    sides of them; through thinner ones it may lead.
    """

    def __init__(
        self, costs: NDArray[np.uint8], weights: NDArray[np.float32], start: Cell, goal: Cell, band: float
    ) -> None:
        blocks = [-(-size // BLOCK) + 2 for size in costs.shape]
        coarse = np.full(blocks, _CLOSED, np.uint8)
        coarsen(costs, weights, coarse)
        self._start = _block(start)
        # A step over a block is as much as BLOCK over cells: bands of less than that would be of one block each.
        self._wave = Wave(coarse, _BLOCK_WEIGHTS, _block(goal), band * BLOCK)

    def advance(self, budget: int) -> bool:
        """Visits about ``budget`` blocks; returns whether the guide is ready."""
        return self._wave.advance(self._start, budget)

    def result(self) -> tuple[NDArray[np.float32], float]:
        """Returns the potential by block, and the start's; what the wave has not reached counts as its last limit."""
        potential = np.minimum(self._wave.potential, np.float32(self._wave.limit))
        return potential, float(potential[self._start])


def _block(cell: Cell) -> Cell:
    return cell[0] // BLOCK + 1, cell[1] // BLOCK + 1
