"""Reference laser ranges by trimesh: rays cast against triangles; trimesh loads the mesh files itself."""

import functools
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import Box, Cylinder, Mesh, Plane, Shape, Sphere
from pioneer_gazebo.world.pose import Pose

SIDES = 96
"""Number of sides of the prisms that approximate cylinders."""


def mesh_at(height: float, placed: Iterable[tuple[Shape, Pose]]) -> trimesh.Trimesh:
    """Returns the triangles that reach across ``height`` [m]; each shape comes with its pose in the world.

    A horizontal beam at that height can hit no others.
    """
    parts = []
    for shape, pose in placed:
        if isinstance(shape, Plane):
            continue
        surface = _surface(shape)
        corners = trimesh.transform_points(surface.vertices, pose.matrix())
        heights = corners[:, 2][surface.faces]
        crossing = (heights.min(axis=1) <= height) & (heights.max(axis=1) >= height)
        if crossing.any():
            parts.append(trimesh.Trimesh(corners, surface.faces[crossing], process=False))
    return trimesh.util.concatenate(parts) if parts else trimesh.Trimesh()


def distances(
    mesh: trimesh.Trimesh, origin: NDArray[np.float64], beams: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Returns the range [m] of each beam to the mesh; +inf if it hits nothing.

    Args:
        mesh: the world.
        origin: of all beams, shape (3,) [m].
        beams: unit vectors, shape (m, 3).
    """
    found = np.full(len(beams), math.inf)
    if len(mesh.faces):
        points, rays, _ = mesh.ray.intersects_location(np.broadcast_to(origin, beams.shape), beams)
        np.minimum.at(found, rays, np.linalg.norm(points - origin, axis=1))
    return found


@functools.cache
def _surface(shape: Shape) -> trimesh.Trimesh:
    match shape:
        case Box(size=size):
            return trimesh.creation.box(size)
        case Cylinder(radius=radius, length=length):
            return trimesh.creation.cylinder(radius, length, sections=SIDES)
        case Sphere(radius=radius):
            return trimesh.creation.icosphere(subdivisions=4, radius=radius)
        case Mesh(path=path, scale=scale) if Path(path).suffix.lower() in (".obj", ".stl"):
            return trimesh.load_mesh(path, process=False).apply_scale(scale)
        case Mesh():
            return trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles_of_mesh(shape)))
    return trimesh.Trimesh()
