"""A wave of cost that spreads over a grid, and a guide that makes it hurry towards its goal."""

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core import kernel

FAR = 1.0e10
"""The potential of a cell that was not reached."""
_BLOCK = 4  # cells along the side of a guide's block, as kernels/navfn.py has it
# A guided wave stays where the whole way is at most this many bands longer than the guide says, at first: as much as
# blocks at both ends can be wrong by, in tests with pillars.
_EXCESS = 4.0
_DONE, _FULL = 1, 2
# Blocks have no costs but what they add, up to 253.
_CLOSED = 255
_BLOCK_WEIGHTS = np.append(np.arange(_CLOSED) * float(_BLOCK), -1.0).astype(np.float32)
_NO_GUIDE = np.empty((0, 0), np.float32)

Cell = tuple[int, int]


class Wave:
    """A wave from ``source`` over ``costs``, uint8, shape (rows, cols), which it keeps.

    Args:
        costs: of the cells.
        weights: what crossing a cell of each cost adds, negative where nothing may pass, float32, shape (256,).
        source: row and column where it begins.
        band: how far apart its bands of urgency lie; what lies within one is visited in any order.

    Attributes:
        potential: float32, shape (rows, cols): cost of the cheapest way from the source, ``FAR`` where none was found.
        limit: up to here the potential is final.
    """

    def __init__(self, costs: NDArray[np.uint8], weights: NDArray[np.float32], source: Cell, band: float) -> None:
        self._costs, self._weights = costs, weights
        self._guide = _NO_GUIDE
        self.potential: NDArray[np.float32] = np.empty(costs.shape, np.float32)
        self._waiting = np.empty(costs.shape, np.uint8)
        self._queue = np.empty((4, 4096 + 16 * sum(costs.shape)), np.int32)
        self._counts = np.zeros(4, np.int64)
        self._limits = np.array([0.0, band, 0.0, 0.0])
        kernel.begin(self.potential, self._waiting, costs, weights, self._queue, self._counts, self._limits, *source)

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
        fields = (self.potential, self._waiting, self._costs, self._weights)
        state = (self._counts, self._limits)
        while True:
            status = kernel.spread(*fields, self._queue, *state, *goal, self._guide, budget)
            if status != _FULL:
                return int(status) == _DONE
            self._queue = np.concatenate([self._queue, np.empty_like(self._queue)], axis=1)


class Guide:
    """About what is left of the way to ``goal`` from anywhere: the potential of a wave from there over blocks of cells.

    It is right to some hundredths where walls are thicker than two blocks, or than one with what inflation bars on both
    sides of them; through thinner ones it may lead.
    """

    def __init__(
        self, costs: NDArray[np.uint8], weights: NDArray[np.float32], start: Cell, goal: Cell, band: float
    ) -> None:
        blocks = [-(-size // _BLOCK) + 2 for size in costs.shape]
        coarse = np.full(blocks, _CLOSED, np.uint8)
        kernel.coarsen(costs, weights, coarse)
        self._start = _block(start)
        self._wave = Wave(coarse, _BLOCK_WEIGHTS, _block(goal), band)

    def advance(self, budget: int) -> bool:
        """Visits about ``budget`` blocks; returns whether the guide is ready."""
        return self._wave.advance(self._start, budget)

    def result(self) -> tuple[NDArray[np.float32], float]:
        """Returns the potential by block, and the start's; what the wave has not reached counts as its last limit."""
        potential = np.minimum(self._wave.potential, np.float32(self._wave.limit))
        return potential, float(potential[self._start])


def _block(cell: Cell) -> Cell:
    return cell[0] // _BLOCK + 1, cell[1] // _BLOCK + 1
