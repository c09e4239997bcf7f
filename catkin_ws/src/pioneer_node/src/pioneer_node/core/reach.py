"""Where on a map a robot can be, and where it can get to: the global planner's rule, for all who ask before it plans.

A path keeps more than the footprint's inscribed radius from occupied cells, centre to centre, and goes from cell to
cell. Unknown cells count as free, as the global costmap of pioneer_2dnav has them.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

PIONEER_RADIUS = 0.23
"""Inscribed radius of the Pioneer's footprint in pioneer_2dnav, with its padding [m]."""


def clearance(occupied: NDArray[np.bool_], resolution: float) -> NDArray[np.float64]:
    """Returns each cell's distance to the nearest occupied cell [m], float64 [row, col]; infinite without any.

    Args:
        occupied: bool [row, col].
        resolution: edge of a cell [m].
    """
    if not occupied.any():
        return np.full(occupied.shape, np.inf)
    distance: NDArray[np.float64] = ndimage.distance_transform_edt(~occupied)
    return distance * resolution


def areas(
    occupied: NDArray[np.bool_], resolution: float, radius: float = PIONEER_RADIUS
) -> NDArray[np.int32]:
    """Returns, for each cell, the number of the area in which a robot's centre moves; 0 where it cannot be.

    A robot gets from one cell to another if both have the same number.

    Args:
        occupied: bool [row, col].
        resolution: edge of a cell [m].
        radius: inscribed radius of the robot's footprint, with its padding [m].
    """
    free = clearance(occupied, resolution) > radius
    # As navfn: no path goes along the map's outermost cells.
    free[[0, -1], :] = False
    free[:, [0, -1]] = False
    return connected(free)


def connected(free: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Returns the number of each free cell's area, int32 [row, col]; 0 in other cells."""
    numbers: NDArray[np.int32] = ndimage.label(free, output=np.int32)[0]
    return numbers
