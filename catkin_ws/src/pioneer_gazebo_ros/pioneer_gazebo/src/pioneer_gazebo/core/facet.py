"""Triangle meshes made small enough for an engine."""

import math

import numpy as np
from numpy.typing import NDArray

Triangles = NDArray[np.float64]
"""Shape (n, 3, 3) [m]."""

Points = NDArray[np.float64]
"""Shape (n, 3) [m]."""

TRIANGLES_AT_MOST = 20_000
"""An engine holds a standing mesh of so many triangles."""

CORNERS_AT_MOST = 64
"""An engine holds a moving mesh as the convex hull of so many corners."""

FINEST, COARSER = 1 / 4000, 1.4
"""Corners of a mesh that has too many triangles are joined in grids: the smallest cell, as a part of the mesh's extent,
and by how much the cells of each further grid are larger."""


def reduced(triangles: Triangles, most: int = TRIANGLES_AT_MOST) -> Triangles:
    """Returns the mesh with at most ``most`` triangles: corners that share a cell of a grid become one.

    The grid is as fine as that allows; no corner moves further than a cell's diagonal.
    """
    if len(triangles) <= most:
        return triangles
    corners = triangles.reshape(-1, 3)
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = float(np.linalg.norm(sides, axis=1).sum()) / 2
    # Where the surface is smooth, a cell that it passes through leaves two triangles.
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
    kept = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    _, once = np.unique(np.sort(faces[kept], axis=1), axis=0, return_index=True)
    return corners[first][faces[kept][np.sort(once)]]


def hull_points(triangles: Triangles, most: int = CORNERS_AT_MOST) -> Points:
    """Returns the mesh's corners, or, where there are more than ``most``, those that are outermost in many directions.

    The hull of these lies inside the mesh's; in each direction it ends where the mesh does.
    """
    corners = triangles.reshape(-1, 3)
    if len(corners) <= 100 * most:
        corners = np.unique(corners, axis=0)
    if len(corners) <= most:
        return corners
    outermost = [int(np.argmax(corners @ direction)) for direction in _directions(most)]
    return np.unique(corners[outermost], axis=0)


def _directions(most: int) -> NDArray[np.float64]:
    """Returns so many unit vectors spread evenly over all directions, the axes' among them."""
    count = most - 6
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.arange(count) * math.pi * (3.0 - math.sqrt(5.0))
    ring = np.sqrt(1.0 - height**2)
    return np.vstack([np.eye(3), -np.eye(3), np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])])
