"""Rays against triangles in space: what lasers should see, worked out in another way than the simulator does."""

import itertools
import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.core.section import Triangles
from pioneer_gazebo.core.world import Box, Cylinder, Mesh, Shape, Sphere

SIDES, RINGS = 96, 48
"""Of the prisms and balls that stand for cylinders and spheres."""

Corners = NDArray[np.float64]
"""Triangles, shape (n, 3, 3) [m]."""


def triangles_of(placed: Iterable[tuple[Shape, Pose]], read: Triangles) -> Corners:
    """Returns the surfaces of shapes, each with its pose in the world, as triangles; planes are left out."""
    parts = [_placed(_surface(shape, read), pose) for shape, pose in placed]
    return np.concatenate([np.empty((0, 3, 3)), *parts])


def distances(corners: Corners, origin: NDArray[np.float64], beams: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns how far each beam goes [m] until it meets a triangle; +inf where none does (Möller and Trumbore).

    Args:
        corners: the triangles.
        origin: shape (3,) [m].
        beams: unit vectors, shape (m, 3).
    """
    a = corners[:, 0]
    u, v = corners[:, 1] - a, corners[:, 2] - a
    found = np.full(len(beams), math.inf)
    for number, beam in enumerate(beams):
        h = np.cross(beam, v)
        det = np.einsum("ij,ij->i", u, h)
        det = np.where(np.abs(det) < 1e-12, np.nan, det)
        s = origin - a
        q = np.cross(s, u)
        first, second = np.einsum("ij,ij->i", s, h) / det, (q @ beam) / det
        along = np.einsum("ij,ij->i", v, q) / det
        met = (first >= -1e-9) & (second >= -1e-9) & (first + second <= 1 + 1e-9) & (along > 1e-6)
        if met.any():
            found[number] = along[met].min()
    return found


def _placed(corners: Corners, pose: Pose) -> Corners:
    matrix = pose.matrix()
    return corners @ matrix[:3, :3].T + matrix[:3, 3]


def _surface(shape: Shape, read: Triangles) -> Corners:
    """Returns a shape's surface in its own frame; planes have none."""
    if isinstance(shape, Mesh):
        return read(shape)
    if isinstance(shape, Box):
        x, y, z = (side / 2 for side in shape.size)
        return _prism(np.array([(x, y), (-x, y), (-x, -y), (x, -y)]), z)
    if isinstance(shape, Cylinder):
        turns = np.arange(SIDES) * math.tau / SIDES
        return _prism(shape.radius * np.column_stack([np.cos(turns), np.sin(turns)]), shape.length / 2)
    if isinstance(shape, Sphere):
        return _ball(shape.radius)
    return np.empty((0, 3, 3))


def _prism(rim: NDArray[np.float64], half: float) -> Corners:
    """Returns the upright prism on a polygon about the origin, from -half to half."""
    low, high = (np.column_stack([rim, np.full(len(rim), z)]) for z in (-half, half))
    return np.concatenate([_strip(low, high), _fan(low), _fan(high)])


def _strip(a: Corners, b: Corners) -> Corners:
    """Returns the triangles between two closed lines of as many points."""
    c, d = np.roll(a, -1, axis=0), np.roll(b, -1, axis=0)
    return np.concatenate([np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)])


def _fan(rim: Corners) -> Corners:
    middle = np.broadcast_to(rim.mean(axis=0), rim.shape)
    return np.stack([middle, rim, np.roll(rim, -1, axis=0)], axis=1)


def _ball(radius: float) -> Corners:
    turns = np.arange(SIDES) * math.tau / SIDES
    rings = [
        np.column_stack([math.sin(v) * np.cos(turns), math.sin(v) * np.sin(turns), np.full(SIDES, math.cos(v))])
        for v in np.linspace(0.0, math.pi, RINGS)
    ]
    return radius * np.concatenate([_strip(a, b) for a, b in itertools.pairwise(rings)])
