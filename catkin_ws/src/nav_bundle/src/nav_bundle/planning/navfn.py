"""The global planner NavfnROS: computes a potential over the costmap and descends its gradient."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.cost import INSCRIBED, UNKNOWN
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.geometry import Geometry
from nav_bundle.planning import navfn_kernel as kernel
from nav_bundle.planning.navfn_kernel import (
    BLOCK,
    DONE,
    FAR,
    FULL,
    Cell,
    Front,
    begin,
    coarsen,
    spread,
)
from nav_bundle.planning.planner import GoalOutsideError, NoPathError, Path, StartOutsideError
from pioneer_node.core.parameter import WithoutEffect

NEUTRAL_COST = 50
"""Weight of a free cell."""
COST_FACTOR = 0.8
"""Weight added per unit of costmap cost."""
HIGHEST_COST = 253
"""Highest weight of a traversable cell."""
MEETING_DISTANCE = 3.0
"""Unmapped obstacles within this distance [m] are passed on the right."""

_BLOCKED = -1
# Width of the wavefront's priority bands. navfn uses two steps over free ground; four are the fastest here.
_BAND = 4.0 * NEUTRAL_COST
# Unmapped obstacles are passed on the right: a line to their left, of this length and half width [m], costs as much
# to cross as about a metre of free ground.
_SHUNNED_LENGTH, _SHUNNED_DEPTH = 2.5, 0.15
# A guided wave first visits only cells where the total path is at most this many bands longer than the guide's
# estimate: the error of the blocks at both ends, measured in tests with pillars.
_EXCESS = 4.0
# The cost of a block is its weight, up to 253.
_CLOSED = 255
_BLOCK_WEIGHTS = np.append(np.arange(_CLOSED) * float(BLOCK), -1.0).astype(np.float32)
_NO_GUIDE = np.empty((0, 0), np.float32)

WHOLE_MAP = WithoutEffect("is read and not used, as in Noetic: plans are searched in the whole map")
NO_CLOUD = WithoutEffect("is not available: no cloud of potentials is published")


@dataclass(frozen=True)
class NavfnConfig:
    """Parameters under ``~NavfnROS``.

    Not in Noetic: ``keep_right`` passes unmapped obstacles, such as other robots, on the right unless that is a metre
    longer, so that two robots that meet do not dodge to the same side.
    """

    allow_unknown: bool = True
    default_tolerance: float = 0.0
    visualize_potential: Annotated[bool, NO_CLOUD] = False
    planner_window_x: Annotated[float, WHOLE_MAP] = 0.0
    planner_window_y: Annotated[float, WHOLE_MAP] = 0.0
    keep_right: bool = True


def weights(allow_unknown: bool) -> NDArray[np.float32]:
    """Returns the potential added by crossing a cell, by its cost; negative if blocked. Shape (256,)."""
    table = np.floor(np.minimum(NEUTRAL_COST + COST_FACTOR * np.arange(256), HIGHEST_COST)).astype(
        np.float32
    )
    table[INSCRIBED:] = _BLOCKED
    table[UNKNOWN] = HIGHEST_COST if allow_unknown else _BLOCKED
    return table


class NavfnPlanner:
    """Plans as navfn does: cells weigh ``50 + 0.8 cost``, so paths avoid the inflated area around walls.

    The wavefront starts at the robot. If the goal itself is blocked, the nearest reachable cell within the tolerance
    is thus known. Unlike in navfn, a robot whose centre is in an inscribed cell can leave it: inscribed cells within
    its inscribed radius are traversable at the highest cost.
    """

    def __init__(self, config: NavfnConfig) -> None:
        self.config = config
        self._weights = weights(config.allow_unknown)
        self._guided = False
        self._follow_cells = False

    def _finished(self, start: Pose, path: Path) -> Path:
        """Returns the path after post-processing; hook for subclasses."""
        return path

    def search(
        self, costmap: Costmap, start: Pose, goal: Pose, tolerance: float | None = None
    ) -> "NavfnSearch":
        """Starts a search on a copy of the costmap's cells; see ``planner.GlobalPlanner``."""
        place = costmap.geometry
        start_cell, goal_cell = place.cell_at(start.x, start.y), place.cell_at(goal.x, goal.y)
        if not place.contains(start_cell):
            raise StartOutsideError(
                "The robot's start position is off the global costmap. Planning will always fail, "
                "are you sure the robot has been properly localized?"
            )
        if not place.contains(goal_cell):
            raise GoalOutsideError(
                "The goal sent to the navfn planner is off the global costmap. Planning will always fail to this goal."
            )
        costs = costmap.cells.copy()
        _open_around(costs, start_cell, costmap.footprint.inscribed_radius / place.resolution)
        if self.config.keep_right:
            _keep_right(costs, place, start, costmap.unmapped(start, MEETING_DISTANCE))
        reach = self.config.default_tolerance if tolerance is None else tolerance
        search = NavfnSearch(
            costs, replace(place), start_cell, goal_cell, goal, reach, self._weights, self._guided
        )
        search.finish, search.follow_cells = partial(self._finished, start), self._follow_cells
        return search


class NavfnSearch:
    """One incremental search; each call to ``advance`` continues the wavefront."""

    def __init__(
        self,
        costs: NDArray[np.uint8],
        geometry: Geometry,
        start: Cell,
        goal_cell: Cell,
        goal: Pose,
        tolerance: float,
        weight: NDArray[np.float32],
        guided: bool = False,
    ) -> None:
        self.geometry = geometry  #: geometry of the cells
        self.costs = costs  #: costs of the cells, uint8, shape (rows, cols)
        self.weights = weight  #: potential added by crossing a cell of each cost, negative if blocked, shape (256,)
        #: post-processes the path that was found
        self.finish: Callable[[Path], Path] = lambda path: path
        self.follow_cells = False  #: follow the path from cell to cell instead of down the gradient
        self._start, self._goal_cell, self._goal = start, goal_cell, goal
        self._tolerance = tolerance
        self._wave = Wave(costs, weight, start, _BAND)
        self._guide = Guide(costs, weight, start, goal_cell, _BAND) if guided else None

    @property
    def potential(self) -> NDArray[np.float32]:
        """Cost of the cheapest path from the robot, float32, shape (rows, cols); ``FAR`` in cells not reached."""
        return self._wave.potential

    def advance(self, budget: int) -> Path | None:
        """Visits about ``budget`` more cells; see ``planner.Search``."""
        if self._guide:
            if not self._guide.advance(budget):
                return None
            self._wave.follow(*self._guide.result())
            self._guide = None
        return self._path() if self._wave.advance(self._goal_cell, budget) else None

    def _path(self) -> Path:
        """Returns the path from the robot to the goal, or to the nearest reached cell within the tolerance."""
        exact = self.potential[self._goal_cell] < FAR
        end = self._goal_cell if exact else self._nearest()
        steps = np.empty((4 * sum(self.potential.shape) + self.potential.size // 8, 2), np.float64)
        descend = kernel.descend_cells if self.follow_cells else kernel.descend
        steps = steps[: descend(self.potential, steps, end, self._start)]
        if len(steps) == 0 and end != self._start:
            raise NoPathError(
                "Failed to get a plan from potential when a legal potential was found."
            )
        return self.finish(self._poses(steps[::-1], exact))

    def _nearest(self) -> Cell:
        cell = kernel.nearest_reached(
            self.potential, self._goal_cell, self._tolerance / self.geometry.resolution
        )
        if cell < 0:
            raise NoPathError("Failed to get a plan.")
        row, col = divmod(int(cell), self.geometry.cols)
        return row, col

    def _poses(self, cells: NDArray[np.float64], exact: bool) -> Path:
        """Returns the poses at ``cells`` (row, col): yaw 0 as in navfn, the goal's heading at the last one."""
        place = self.geometry
        path = np.zeros((max(len(cells), 1), 3))
        path[: len(cells), 0] = place.origin_x + (cells[:, 1] + 0.5) * place.resolution
        path[: len(cells), 1] = place.origin_y + (cells[:, 0] + 0.5) * place.resolution
        if exact or not len(cells):
            path[-1, :2] = self._goal.x, self._goal.y
        path[-1, 2] = self._goal.yaw
        return path


def _open_around(costs: NDArray[np.uint8], cell: Cell, radius: float) -> None:
    """Makes the inscribed cells within ``radius`` [cells] traversable at the highest cost."""
    reach = int(np.ceil(radius))
    rows = np.arange(max(cell[0] - reach, 0), min(cell[0] + reach + 1, costs.shape[0]))
    cols = np.arange(max(cell[1] - reach, 0), min(cell[1] + reach + 1, costs.shape[1]))
    near = (rows[:, None] - cell[0]) ** 2 + (cols[None, :] - cell[1]) ** 2 <= radius * radius
    part = costs[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    part[near & (part == INSCRIBED)] = INSCRIBED - 1


def _keep_right(
    costs: NDArray[np.uint8], place: Geometry, robot: Pose, unmapped: NDArray[np.float64]
) -> None:
    """Draws a line of high cost from each unmapped point (n, 2) [m] to its left, as seen from the robot."""
    if not len(unmapped):
        return
    towards = unmapped - (robot.x, robot.y)
    towards /= np.maximum(np.hypot(towards[:, 0], towards[:, 1]), place.resolution)[:, None]
    left = np.stack([-towards[:, 1], towards[:, 0]], axis=1)
    aside = np.arange(0.0, _SHUNNED_LENGTH, place.resolution)[:, None, None, None]
    behind = np.arange(-_SHUNNED_DEPTH, _SHUNNED_DEPTH, place.resolution)[None, :, None, None]
    points = (unmapped + aside * left + behind * towards).reshape(-1, 2)
    cells = np.floor((points - (place.origin_x, place.origin_y)) / place.resolution).astype(
        np.int64
    )
    inside = ((cells >= 0) & (cells < (place.cols, place.rows))).all(axis=1)
    cols, rows = cells[inside].T
    open_ground = costs[rows, cols] < INSCRIBED
    costs[rows[open_ground], cols[open_ground]] = INSCRIBED - 1


class Wave:
    """A wave from ``source`` over ``costs``.

    Args:
        costs: costs of the cells, uint8, shape (rows, cols); not copied.
        weights: potential added by crossing a cell of each cost, negative if blocked, float32, shape (256,).
        source: row and column of the start.
        band: width of the priority bands; cells within a band are visited in any order.
    """

    def __init__(
        self, costs: NDArray[np.uint8], weights: NDArray[np.float32], source: Cell, band: float
    ) -> None:
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
            self._front = self._front._replace(
                queue=np.concatenate([queue, np.empty_like(queue)], axis=1)
            )
        return status == DONE


class Guide:
    """Heuristic for the remaining cost to ``goal``: the potential of a wave from the goal over blocks of cells.

    It is accurate to a few percent if walls are thicker than two blocks, or than one block including the cells that
    inflation blocks on both sides. It may lead through thinner walls.
    """

    def __init__(
        self,
        costs: NDArray[np.uint8],
        weights: NDArray[np.float32],
        start: Cell,
        goal: Cell,
        band: float,
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
