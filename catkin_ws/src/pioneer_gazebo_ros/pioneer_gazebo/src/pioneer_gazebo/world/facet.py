"""Simplifies triangle meshes for a physics engine."""

import math

import numpy as np
from numpy.typing import NDArray

Triangles = NDArray[np.float64]
"""Shape (n, 3, 3) [m]."""

Points = NDArray[np.float64]
"""Shape (n, 3) [m]."""

TRIANGLES_AT_MOST = 20_000
"""Maximum number of triangles of a static mesh."""

CORNERS_AT_MOST = 64
"""Maximum number of vertices of a moving mesh's convex hull."""

FINEST, COARSER = 1 / 4000, 1.4
"""Vertices of a mesh with too many triangles are merged on a grid: the smallest cell size relative to the mesh's
extent, and the factor by which cells grow from one attempt to the next."""


def reduced(triangles: Triangles, most: int = TRIANGLES_AT_MOST) -> Triangles:
    """Returns the mesh with at most ``most`` triangles by merging vertices that share a cell of a grid.

    It uses the finest grid that achieves this; no vertex moves further than a cell's diagonal.
    """
    if len(triangles) <= most:
        return triangles
    corners = triangles.reshape(-1, 3)
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = float(np.linalg.norm(sides, axis=1).sum()) / 2
    # On a smooth surface, each cell it passes through leaves two triangles.
    cell = max(float(np.ptp(corners, axis=0).max()) * FINEST, math.sqrt(2 * area / most))
    found = triangles
    while len(found) > most:
        found = _joined(corners, cell)
        cell *= COARSER
    return found


def _joined(corners: Points, cell: float) -> Triangles:
    cells = ((corners - corners.min(axis=0)) / cell).astype(np.int64)
    _, cols, layers = cells.max(axis=0) + 1
    numbers = (cells[:, 0] * cols + cells[:, 1]) * layers + cells[:, 2]
    _, first, index = np.unique(numbers, return_index=True, return_inverse=True)
    faces = index.reshape(-1, 3)
    kept = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    _, once = np.unique(np.sort(faces[kept], axis=1), axis=0, return_index=True)
    return corners[first][faces[kept][np.sort(once)]]


def hull_points(triangles: Triangles, most: int = CORNERS_AT_MOST) -> Points:
    """Returns the mesh's vertices or, if there are more than ``most``, the outermost ones in evenly spread directions.

    Their hull lies inside the mesh's hull and touches it in each of these directions.
    """
    corners = triangles.reshape(-1, 3)
    if len(corners) <= 100 * most:
        corners = np.unique(corners, axis=0)
    if len(corners) <= most:
        return corners
    outermost = [int(np.argmax(corners @ direction)) for direction in _directions(most)]
    return np.unique(corners[outermost], axis=0)


def _directions(most: int) -> NDArray[np.float64]:
    """Returns ``most`` unit vectors spread evenly over all directions, including the axes."""
    count = most - 6
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.arange(count) * math.pi * (3.0 - math.sqrt(5.0))
    ring = np.sqrt(1.0 - height**2)
    return np.vstack(
        [np.eye(3), -np.eye(3), np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])]
    )
