"""Finds the shape that a point belongs to, to name the touched collision among batched shapes."""

import math
from collections.abc import Iterable

from pioneer_gazebo.core.pose import Pose, Vector
from pioneer_gazebo.core.world import Box, Cylinder, PlacedCollision, Plane, Shape, Sphere


def distance_to(shape: Shape, pose: Pose, point: Vector) -> float:
    """Returns the distance [m] from a point to a shape, 0 inside; for a mesh, to its origin."""
    x, y, z = pose.inverse().transform(point)
    match shape:
        case Box(size=size):
            return math.hypot(*(max(0.0, abs(v) - s / 2) for v, s in zip((x, y, z), size, strict=True)))
        case Cylinder(radius=radius, length=length):
            return math.hypot(max(0.0, math.hypot(x, y) - radius), max(0.0, abs(z) - length / 2))
        case Sphere(radius=radius):
            return max(0.0, math.hypot(x, y, z) - radius)
        case Plane(normal=(a, b, c)):
            return max(0.0, a * x + b * y + c * z)
        case _:
            return math.hypot(x, y, z)


def nearest(placed: Iterable[PlacedCollision], point: Vector) -> PlacedCollision | None:
    """Returns the collision nearest to a point; None if there are none."""
    distances = [(distance_to(one.collision.shape, one.pose, point), number, one) for number, one in enumerate(placed)]
    return min(distances)[2] if distances else None


def scoped_name(one: PlacedCollision) -> str:
    """Returns ``model::link::collision``."""
    return f"{one.model.name}::{one.link.name}::{one.collision.name}"
