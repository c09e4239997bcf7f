"""Wheels for the engine: balls that roll on the ground, and drums that collide with obstacles in their place.

A ball touches the ground at a single point, which makes the simulated wheel exact. As it is wider than the wheel, it
would hit walls beside the wheel, so it collides with the ground only.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.world import joint as kinds
from pioneer_gazebo.world.joint import Joint
from pioneer_gazebo.world.model import Collision, Cylinder, Mesh, Sphere
from pioneer_gazebo.world.pose import Pose, Vector, rotated
from pioneer_gazebo.world.section import Triangles

CLEARANCE = 0.004
"""Height of a wheel's drum above the ground [m]; the drum collides with obstacles."""

DRUM_FRICTION = 0.2

OFF_AXIS = 1e-3
"""A shape rotates in place if its centre is within this distance of the joint's axis [m]."""

SECTORS, ROUNDNESS = 12, 0.9
"""A mesh is round if its radius in each of the sectors is at least this fraction of the maximum radius."""

LEVEL = 0.1
"""Maximum vertical component of a wheel axis (unit vector)."""


@dataclass(frozen=True, slots=True)
class Touch:
    """A collision shape of a part."""

    link: str  #: name of the link it belongs to
    collision: Collision  #: the shape; its pose is in the part's frame
    rolling: bool = False  #: whether it collides with the ground only


Round = tuple[float, float, float]
"""A shape that rotates in place: its radius, and its least and greatest extent along the axis from the origin [m]."""


def is_wheel(touches: Iterable[Touch], joint: Joint, parent: Pose, triangles: Triangles) -> bool:
    """Returns whether a part is a passive wheel: round about a level axis, but not already a sphere.

    Args:
        touches: the part's shapes.
        joint: the joint that moves the part.
        parent: pose of the parent part in the base.
        triangles: reads meshes.
    """
    shapes = [touch.collision for touch in touches]
    axis = rotated(parent.compose(joint.pose).rotation, joint.axis)
    return (
        joint.kind == kinds.CONTINUOUS
        and abs(axis[2]) < LEVEL
        and bool(shapes)
        and all(
            not isinstance(one.shape, Sphere) and _round(one, joint.axis, triangles)
            for one in shapes
        )
    )


def as_balls(
    touches: Iterable[Touch], joint: Joint, triangles: Triangles
) -> tuple[list[Touch], list[Touch]]:
    """Returns a wheel's shapes as rolling balls, and the drums that its parent gets to collide with obstacles.

    Shapes that are round about the joint's axis become balls of that radius; others are kept.
    """
    balls, drums = [], []
    for touch in touches:
        found = _round(touch.collision, joint.axis, triangles)
        if found is None:
            balls.append(touch)
            continue
        radius, low, high = found
        x, y, z = joint.axis
        along = (low + high) / 2
        middle = (x * along, y * along, z * along)
        ball = replace(touch.collision, shape=Sphere(radius), pose=Pose(middle))
        balls.append(replace(touch, collision=ball, rolling=True))
        if not isinstance(touch.collision.shape, Sphere) and radius > 2 * CLEARANCE:
            shape = Cylinder(radius - CLEARANCE, high - low)
            pose = joint.pose.compose(Pose(middle, _from_z(joint.axis)))
            drum = replace(touch.collision, shape=shape, pose=pose, friction=DRUM_FRICTION)
            drums.append(replace(touch, collision=drum))
    return balls, drums


def _round(collision: Collision, axis: Vector, triangles: Triangles) -> Round | None:
    """Returns radius and extent of a shape that is round about ``axis`` through the part's origin; otherwise None."""
    shape, pose = collision.shape, collision.pose
    if isinstance(shape, Mesh):
        return _round_mesh(pose, triangles(shape).reshape(-1, 3), np.array(axis))
    if not isinstance(shape, Cylinder | Sphere):
        return None
    if float(np.linalg.norm(np.cross(pose.position, axis))) > OFF_AXIS:
        return None
    if (
        isinstance(shape, Cylinder)
        and abs(float(np.dot(rotated(pose.rotation, (0.0, 0.0, 1.0)), axis))) < 0.999
    ):
        return None
    middle = float(np.dot(pose.position, axis))
    half = shape.length / 2 if isinstance(shape, Cylinder) else shape.radius
    return shape.radius, middle - half, middle + half


def _round_mesh(
    pose: Pose, corners: NDArray[np.float64], axis: NDArray[np.float64]
) -> Round | None:
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
    return radius, float(along.min()), float(along.max())


def _from_z(axis: Vector) -> tuple[float, float, float, float]:
    """Returns a rotation that takes the z axis to ``axis``."""
    x, y, z = axis
    if z < -0.999999:
        return 1.0, 0.0, 0.0, 0.0
    length = math.sqrt(2.0 * (1.0 + z))
    return -y / length, x / length, 0.0, length / 2
