"""Wavefront propagation of path costs over a grid, and a coarse heuristic that guides it to the goal."""

import numpy as np
from numpy.typing import NDArray

from nav_bundle.kernels.navfn import BLOCK, DONE, FULL, Cell, Front, begin, coarsen, spread

# A guided wave first visits only cells where the total path is at most this many bands longer than the guide's
# estimate: the error of the blocks at both ends, measured in tests with pillars.
_EXCESS = 4.0
# The cost of a block is its weight, up to 253.
_CLOSED = 255
_BLOCK_WEIGHTS = np.append(np.arange(_CLOSED) * float(BLOCK), -1.0).astype(np.float32)
_NO_GUIDE = np.empty((0, 0), np.float32)


class Wave:
    """A wave from ``source`` over ``costs``.

    Args:
        costs: costs of the cells, uint8, shape (rows, cols); not copied.
        weights: potential added by crossing a cell of each cost, negative if blocked, float32, shape (256,).
        source: row and column of the start.
        band: width of the priority bands; cells within a band are visited in any order.
    """

    def __init__(self, costs: NDArray[np.uint8], weights: NDArray[np.float32], source: Cell, band: float) -> None:
        self._guide = _NO_GUIDE
        #: float32, shape (rows, cols): cost of the cheapest path from the source, ``FAR`` in cells not reached
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
        """Potentials below this value are final, in a wave without a guide."""
        return float(self._limits[0])

    def follow(self, guide: NDArray[np.float32], ahead: float) -> None:
        """Uses ``guide`` from now on; ``ahead`` is its potential at the source."""
        self._guide = guide
        excess = _EXCESS * self._limits[1]
        self._limits[2:] = ahead + excess, excess

    def advance(self, goal: Cell, budget: int) -> bool:
        """Visits about ``budget`` cells; returns whether the potential of ``goal`` is final or no cells are left."""
        while (status := spread(self._front, goal, self._guide, budget)) == FULL:
            queue = self._front.queue
            self._front = self._front._replace(queue=np.concatenate([queue, np.empty_like(queue)], axis=1))
        return status == DONE


class Guide:
    """Heuristic for the remaining cost to ``goal``: the potential of a wave from the goal over blocks of cells.

    It is accurate to a few percent if walls are thicker than two blocks, or than one block including the cells that
    inflation blocks on both sides. It may lead through thinner walls.
    """

    def __init__(
        self, costs: NDArray[np.uint8], weights: NDArray[np.float32], start: Cell, goal: Cell, band: float
    ) -> None:
        blocks = [-(-size // BLOCK) + 2 for size in costs.shape]
        coarse = np.full(blocks, _CLOSED, np.uint8)
        coarsen(costs, weights, coarse)
        self._start = _block(start)
        # A step over a block costs as much as BLOCK steps over cells; narrower bands would hold single blocks.
        self._wave = Wave(coarse, _BLOCK_WEIGHTS, _block(goal), band * BLOCK)

    def advance(self, budget: int) -> bool:
        """Visits about ``budget`` blocks; returns whether the guide is ready."""
        return self._wave.advance(self._start, budget)

    def result(self) -> tuple[NDArray[np.float32], float]:
        """Returns the potential of all blocks and that of the start; values are capped at the wave's last limit."""
        potential = np.minimum(self._wave.potential, np.float32(self._wave.limit))
        return potential, float(potential[self._start])


def _block(cell: Cell) -> Cell:
    return cell[0] // BLOCK + 1, cell[1] // BLOCK + 1
