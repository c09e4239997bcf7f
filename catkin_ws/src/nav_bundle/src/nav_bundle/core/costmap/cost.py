"""What a cell of a costmap may cost, and how that reads as an occupancy value."""

import math

import numpy as np
from numpy.typing import NDArray

FREE = 0
"""Nothing is near."""
INSCRIBED = 253
"""The robot's centre cannot be here without touching an obstacle."""
LETHAL = 254
"""An obstacle."""
UNKNOWN = 255
"""Nobody has looked."""


def cells_of_distance(distance: float, resolution: float) -> int:
    """Returns ``distance`` [m] as a whole number of cells, rounded up, never negative."""
    return max(0, math.ceil(round(distance / resolution, 9)))


def cost_by_squared_distance(
    radius: int, resolution: float, inscribed_radius: float, scaling: float
) -> NDArray[np.uint8]:
    """Returns the cost of a cell by its squared distance [cells**2] to the nearest obstacle.

    ``LETHAL`` at the obstacle, ``INSCRIBED`` up to ``inscribed_radius`` [m], beyond it
    ``252 exp(-scaling (distance - inscribed_radius))``, cut to whole numbers, as costmap_2d has it.
    Shape (radius**2 + 1,), ``radius`` in cells, ``scaling`` [1/m].
    """
    distance = np.sqrt(np.arange(radius * radius + 1)) * resolution
    falling = np.exp(-scaling * np.maximum(distance - inscribed_radius, 0.0)) * (INSCRIBED - 1)
    table = np.where(distance <= inscribed_radius, INSCRIBED, falling.astype(np.uint8)).astype(np.uint8)
    table[0] = LETHAL
    return table


def cost_by_occupancy(
    lethal_threshold: int, trinary: bool, track_unknown: bool, unknown_value: int
) -> NDArray[np.uint8]:
    """Returns the cost of a map's cell by its value as unsigned byte: 0 to 100, and 255 for -1."""
    values = np.arange(256)
    scaled = np.zeros(256) if trinary else values / lethal_threshold * LETHAL
    table = np.where(values >= lethal_threshold, LETHAL, scaled).astype(np.uint8)
    table[unknown_value % 256] = UNKNOWN if track_unknown else FREE
    return table


def occupancy_by_cost() -> NDArray[np.int8]:
    """Returns the value that is published for each cost: 0 free, 1 to 98 scaled, 99, 100, -1 (costmap_2d's table)."""
    table = np.array([0, *(1 + 97 * (cost - 1) // 251 for cost in range(1, 253)), 99, 100, -1])
    return table.astype(np.int8)
