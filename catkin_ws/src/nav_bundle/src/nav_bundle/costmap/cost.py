"""Costs of a costmap's cells, and their conversion from and to occupancy values."""

import math

import numpy as np
from numpy.typing import NDArray

FREE = 0
"""No obstacle within the inflation radius."""
INSCRIBED = 253
"""With its centre in this cell, the robot touches an obstacle."""
LETHAL = 254
"""An obstacle."""
UNKNOWN = 255
"""Not observed yet."""


def cells_of_distance(distance: float, resolution: float) -> int:
    """Returns ``distance`` [m] as a whole number of cells, rounded up, never negative."""
    return max(0, math.ceil(round(distance / resolution, 9)))


def cost_by_squared_distance(
    radius: int, resolution: float, inscribed_radius: float, scaling: float
) -> NDArray[np.uint8]:
    """Returns a table of costs by squared distance [cells**2] to the nearest obstacle.

    ``LETHAL`` at the obstacle, ``INSCRIBED`` up to ``inscribed_radius`` [m], beyond it
    ``252 exp(-scaling (distance - inscribed_radius))``, truncated to an integer, as in costmap_2d.
    Shape (radius**2 + 1,), ``radius`` in cells, ``scaling`` [1/m].
    """
    distance = np.sqrt(np.arange(radius * radius + 1)) * resolution
    falling = np.exp(-scaling * np.maximum(distance - inscribed_radius, 0.0)) * (INSCRIBED - 1)
    table = np.where(distance <= inscribed_radius, INSCRIBED, falling.astype(np.uint8)).astype(
        np.uint8
    )
    table[0] = LETHAL
    return table


def cost_by_occupancy(
    lethal_threshold: int, trinary: bool, track_unknown: bool, unknown_value: int
) -> NDArray[np.uint8]:
    """Returns a table, shape (256,), from a map cell's value as unsigned byte (0 to 100, 255 for -1) to its cost.

    A ``lethal_threshold`` outside 0 to 100 is clamped, as by costmap_2d: published files have 254 there.
    """
    values = np.arange(256)
    lethal_threshold = min(max(lethal_threshold, 0), 100)
    scaled = np.zeros(256) if trinary else values / max(lethal_threshold, 1) * LETHAL
    table = np.where(values >= lethal_threshold, LETHAL, scaled).astype(np.uint8)
    table[unknown_value % 256] = UNKNOWN if track_unknown else FREE
    return table


def occupancy_by_cost() -> NDArray[np.int8]:
    """Returns the published occupancy for each cost: 0 free, 1 to 98 scaled, 99, 100, -1 (costmap_2d's table)."""
    table = np.array([0, *(1 + 97 * (cost - 1) // 251 for cost in range(1, 253)), 99, 100, -1])
    return table.astype(np.int8)
