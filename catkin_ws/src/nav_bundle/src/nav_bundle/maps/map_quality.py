"""Compares a map built by a robot with the true map."""

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.maps.grid import FREE, OCCUPIED, Grid


def grown(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns ``mask``, shape (rows, cols), dilated by one cell (eight neighbours)."""
    rows = np.pad(mask, ((1, 1), (0, 0)))
    rows = rows[:-2] | rows[1:-1] | rows[2:]
    columns = np.pad(rows, ((0, 0), (1, 1)))
    return columns[:, :-2] | columns[:, 1:-1] | columns[:, 2:]


def agreement(drawn: Grid, true: Grid, true_from_drawn: Pose) -> float:
    """Returns the intersection over union of the two maps' occupied cells, with a tolerance of one cell.

    In the true map, only cells that a laser can see count: occupied cells next to a free one.

    Args:
        drawn: the robot's map.
        true: the true map, of the same resolution.
        true_from_drawn: pose of the robot's map frame in the true map's frame.

    Returns:
        From 0 to 1: right / (right + wrong + missed). Right are occupied cells of ``drawn`` near a true one, wrong all
        its other occupied cells, missed the true ones without a cell of ``drawn`` nearby. 1 for two empty maps.
    """
    solid = true.cells == OCCUPIED
    surface = solid & grown(true.cells == FREE)
    points = drawn.points_at(np.argwhere(drawn.cells == OCCUPIED))
    cells = true.cells_at(np.stack(true_from_drawn.apply(*points.T), axis=1))
    inside = ((cells >= 0) & (cells < true.cells.shape)).all(axis=1)
    strays = int(np.count_nonzero(~inside))
    found = np.zeros(true.cells.shape, np.bool_)
    found[cells[inside, 0], cells[inside, 1]] = True
    right = int(np.count_nonzero(found & grown(surface)))
    wrong = int(np.count_nonzero(found)) - right + strays
    missed = int(np.count_nonzero(surface & ~grown(found)))
    union = right + wrong + missed
    return right / union if union else 1.0
