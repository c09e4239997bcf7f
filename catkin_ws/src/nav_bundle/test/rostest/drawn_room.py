"""Rooms drawn as text, and the ranges that a laser measures in them; for unit tests and rostests."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.error import MapError
from nav_bundle.base.pose import Pose
from nav_bundle.localisation.likelihood_kernel import expected_ranges
from nav_bundle.localisation.sensor_model import placement
from nav_bundle.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid

CHAMBER = [
    "#########",
    "#.......#",
    "#..#....#",
    "#.......#",
    "#.....###",
    "#.......#",
    "#########",
]
ROOM = [
    "########################",
    "#......................#",
    "#......................#",
    "#......................#",
    "#......................#",
    "#.....##.............###",
    "#.....##...............#",
    "#......................#",
    "#.............###......#",
    "#.............###......#",
    "#......................#",
    "##.....................#",
    "#......................#",
    "#......................#",
    "########################",
]

_CELL_OF_SYMBOL = {"#": OCCUPIED, ".": FREE, " ": FREE, "?": UNKNOWN}


def grid_from_text(
    rows: Sequence[str], resolution: float = 1.0, origin: Pose | None = None
) -> Grid:
    """Returns the grid drawn in ``rows``, the topmost (largest y) first.

    ``#`` is occupied, ``.`` or a space free, ``?`` unknown.

    Raises:
        MapError: the rows differ in length, or contain another symbol.
    """
    try:
        table = [[_CELL_OF_SYMBOL[symbol] for symbol in row] for row in reversed(rows)]
        cells = np.array(table, dtype=np.int8)
    except KeyError as error:
        raise MapError(
            f"a drawn map knows only {' '.join(map(repr, _CELL_OF_SYMBOL))}, not {error}"
        ) from None
    except ValueError:
        raise MapError("a drawn map needs rows of one length") from None
    return Grid(resolution, origin or Pose(), cells)


def enlarged(rows: list[str], scale: int = 8) -> Grid:
    """Returns the grid of a drawing with cells of 5 cm; each symbol is ``scale`` cells wide."""
    cells = np.kron(grid_from_text(rows).cells, np.ones((scale, scale), np.int8))
    return Grid(0.05, Pose(), np.ascontiguousarray(cells))


def ranges_at(
    grid: Grid, pose: Pose, laser: Pose, beams: int = 180, farthest: float = 30.0
) -> NDArray[np.float64]:
    """Returns the exact ranges [m] of a laser mounted at ``laser``, with beams from -pi to pi."""
    ranges = np.empty((1, beams))
    robot = np.array([[pose.x, pose.y, pose.yaw]])
    mounted = np.array([laser.x, laser.y, laser.yaw])
    bearings = np.linspace(-math.pi, math.pi, beams)
    expected_ranges(robot, mounted, bearings, grid.cells, placement(grid), farthest, ranges)
    return ranges[0]
