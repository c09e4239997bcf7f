"""A map to plan in: square rooms with doors, the same for the same seed."""

import numpy as np
from numpy.typing import NDArray

RESOLUTION = 0.05
"""Side of a cell [m]."""
ROOM = 100
"""Side of a room [cells]."""
_DOOR = 30
_OCCUPIED = 100


def room_cells(side: int, seed: int = 1) -> NDArray[np.int8]:
    """Returns occupancy, int8 (side, side), of rooms of 5 m; each wall between two rooms has a door of 1.5 m."""
    generator = np.random.default_rng(seed)
    cells = np.zeros((side, side), np.int8)
    cells[:: side - 1, :] = cells[:, :: side - 1] = _OCCUPIED
    walls = range(ROOM, side - ROOM // 2, ROOM)
    for wall in walls:
        cells[wall, :] = cells[:, wall] = _OCCUPIED
    for wall in walls:
        for room in range(0, side, ROOM):
            across, along = room + generator.integers(15, ROOM - _DOOR - 15, 2)
            cells[wall, across : across + _DOOR] = 0
            cells[along : along + _DOOR, wall] = 0
    return cells
