"""Surfaces that wheels roll on besides the ground: the tops of obstacles.

A wheel is modelled as a ball wider than the real wheel, so it must not collide with the sides of obstacles. Thin slabs
or upward-facing triangles represent their tops and collide with wheels only.
"""

from collections.abc import Sequence
from dataclasses import replace

from pioneer_gazebo.adapters.bullet_body import GROUND, ROLLING
from pioneer_gazebo.adapters.bullet_shape import MeshShapes, batches, fixed_body, standing_body
from pioneer_gazebo.adapters.quiet_pybullet import pybullet
from pioneer_gazebo.core.pose import Pose, conjugate, rotated
from pioneer_gazebo.core.world import Box, Cylinder, Mesh, PlacedCollision

THICKNESS = 0.02
"""Thickness of a slab [m]."""

NARROWEST = 0.2
"""Minimum width of a top that carries wheels [m]."""

UPRIGHT = 0.9


def carriers(placed: Sequence[PlacedCollision], meshes: MeshShapes) -> list[int]:
    """Creates fixed bodies for all tops; returns their pybullet handles."""
    slabs = [slab for one in placed if (slab := _slab(one)) is not None]
    made = [standing_body(batch, meshes) for batch in batches(slabs)]
    for one in placed:
        if isinstance(one.collision.shape, Mesh):
            shape = meshes.of(one.collision.shape, one.pose.matrix()[2, :3])
            if shape >= 0:
                made.append(fixed_body(shape, one.pose, one.collision, meshes.client))
    for body in made:
        pybullet.setCollisionFilterGroupMask(body, -1, GROUND, ROLLING, physicsClientId=meshes.client)
    return made


def _slab(one: PlacedCollision) -> PlacedCollision | None:
    """Returns the top of a box or upright cylinder; None for other shapes and for tops that are too narrow."""
    shape = one.collision.shape
    up = rotated(conjugate(one.pose.rotation), (0.0, 0.0, 1.0))
    if isinstance(shape, Cylinder):
        if abs(up[2]) < UPRIGHT or 2 * shape.radius < NARROWEST:
            return None
        return _top(one, Cylinder(shape.radius, min(THICKNESS, shape.length)), 2, up[2], shape.length)
    if not isinstance(shape, Box):
        return None
    axis = max(range(3), key=lambda index: abs(up[index]))
    size = list(shape.size)
    if min(size[:axis] + size[axis + 1 :]) < NARROWEST:
        return None
    height, size[axis] = size[axis], min(THICKNESS, size[axis])
    return _top(one, Box((size[0], size[1], size[2])), axis, up[axis], height)


def _top(one: PlacedCollision, shape: Box | Cylinder, axis: int, up: float, height: float) -> PlacedCollision:
    thickness = shape.size[axis] if isinstance(shape, Box) else shape.length
    offset = [0.0, 0.0, 0.0]
    offset[axis] = (height - thickness) / 2 * (1.0 if up > 0 else -1.0)
    pose = one.pose.compose(Pose((offset[0], offset[1], offset[2])))
    return replace(one, collision=replace(one.collision, shape=shape), pose=pose)
