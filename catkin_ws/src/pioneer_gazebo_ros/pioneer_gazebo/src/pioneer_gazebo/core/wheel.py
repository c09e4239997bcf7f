"""Wheels for the engine: balls that roll on the ground, and drums that meet obstacles in their place.

A ball touches the ground at one point, which makes an engine's wheels exact; what is wide about it would touch walls
beside the wheel, so that it meets the ground only.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.core import joint as kinds
from pioneer_gazebo.core.joint import Joint
from pioneer_gazebo.core.pose import Pose, Vector, rotated
from pioneer_gazebo.core.section import Triangles
from pioneer_gazebo.core.world import Collision, Cylinder, Mesh, Sphere

CLEARANCE = 0.004
"""The drum that stands for a wheel against obstacles ends this much [m] above the ground."""

DRUM_FRICTION = 0.2

OFF_AXIS = 1e-3
"""A shape turns in place if its middle is this close to the joint's axis [m]."""

SECTORS, ROUNDNESS = 12, 0.9
"""A mesh is round if its radius in each of so many sectors is at least this part of the largest."""

LEVEL = 0.1
"""A wheel's axis rises by at most this part of its length."""


@dataclass(frozen=True, slots=True)
class Touch:
    """A shape of a part."""

    link: str  #: name of the link it came from
    collision: Collision  #: the shape; its pose is in the part's frame
    rolling: bool = False  #: meets the ground only


@dataclass(frozen=True, slots=True)
class Round:
    """A shape that turns in place: its radius and its extent along the axis, from the part's origin [m]."""

    radius: float
    low: float
    high: float


def is_wheel(touches: Iterable[Touch], joint: Joint, parent: Pose, triangles: Triangles) -> bool:
    """Tells whether a part rolls although no drive turns it: round about a level axis, but not a ball as it is.

    Args:
        touches: the part's shapes.
        joint: moves the part.
        parent: pose of the parent part in the base.
        triangles: reads meshes.
    """
    shapes = [touch.collision for touch in touches]
    axis = rotated(parent.compose(joint.pose).rotation, joint.axis)
    return (
        joint.kind == kinds.CONTINUOUS
        and abs(axis[2]) < LEVEL
        and bool(shapes)
        and all(not isinstance(one.shape, Sphere) and _round(one, joint.axis, triangles) for one in shapes)
    )


def as_balls(touches: Iterable[Touch], joint: Joint, triangles: Triangles) -> tuple[list[Touch], list[Touch]]:
    """Returns a wheel's shapes as balls that roll, and the drums for its parent that meet obstacles in their place.

    What is round about the joint's axis becomes a ball of its radius; any other shape stays as it is.
    """
    balls, drums = [], []
    for touch in touches:
        found = _round(touch.collision, joint.axis, triangles)
        if found is None:
            balls.append(touch)
            continue
        middle = _along(joint.axis, (found.low + found.high) / 2)
        ball = replace(touch.collision, shape=Sphere(found.radius), pose=Pose(middle))
        balls.append(replace(touch, collision=ball, rolling=True))
        if not isinstance(touch.collision.shape, Sphere) and found.radius > 2 * CLEARANCE:
            shape = Cylinder(found.radius - CLEARANCE, found.high - found.low)
            pose = joint.pose.compose(Pose(middle, _from_z(joint.axis)))
            drum = replace(touch.collision, shape=shape, pose=pose, friction=DRUM_FRICTION)
            drums.append(replace(touch, collision=drum))
    return balls, drums


def _round(collision: Collision, axis: Vector, triangles: Triangles) -> Round | None:
    """Returns the round that a shape is about ``axis`` through the part's origin, None for any other shape."""
    shape, pose = collision.shape, collision.pose
    if isinstance(shape, Mesh):
        return _round_mesh(pose, triangles(shape).reshape(-1, 3), np.array(axis))
    if not isinstance(shape, Cylinder | Sphere):
        return None
    if float(np.linalg.norm(np.cross(pose.position, axis))) > OFF_AXIS:
        return None
    if isinstance(shape, Cylinder) and abs(float(np.dot(rotated(pose.rotation, (0.0, 0.0, 1.0)), axis))) < 0.999:
        return None
    middle = float(np.dot(pose.position, axis))
    half = shape.length / 2 if isinstance(shape, Cylinder) else shape.radius
    return Round(shape.radius, middle - half, middle + half)


def _round_mesh(pose: Pose, corners: NDArray[np.float64], axis: NDArray[np.float64]) -> Round | None:
    matrix = pose.matrix()
    points = corners @ matrix[:3, :3].T + matrix[:3, 3]
    along = points @ axis
    across = points - along[:, None] * axis
    radii = np.linalg.norm(across, axis=1)
    first = np.cross(axis, (1.0, 0.0, 0.0) if abs(axis[0]) < 0.5 else (0.0, 1.0, 0.0))
    first /= np.linalg.norm(first)
    angles = np.arctan2(across @ np.cross(axis, first), across @ first)
    sectors = ((angles / math.tau + 0.5) * SECTORS).astype(int) % SECTORS
    widest = np.zeros(SECTORS)
    np.maximum.at(widest, sectors, radii)
    radius = float(radii.max())
    if widest.min() < ROUNDNESS * radius:
        return None
    return Round(radius, float(along.min()), float(along.max()))


def _along(axis: Vector, distance: float) -> Vector:
    return axis[0] * distance, axis[1] * distance, axis[2] * distance


def _from_z(axis: Vector) -> tuple[float, float, float, float]:
    """Returns a rotation that turns z to ``axis``."""
    x, y, z = axis
    if z < -0.999999:
        return 1.0, 0.0, 0.0, 0.0
    length = math.sqrt(2.0 * (1.0 + z))
    return -y / length, x / length, 0.0, length / 2
