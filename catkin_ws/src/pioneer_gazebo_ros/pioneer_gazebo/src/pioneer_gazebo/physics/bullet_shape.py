"""Collision shapes in pybullet: individual ones for bodies, batches for the static world."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.body.wheel import Touch
from pioneer_gazebo.physics.engine import EngineError
from pioneer_gazebo.physics.quiet_pybullet import pybullet
from pioneer_gazebo.world.mesh import hull_of_mesh, solid_of_mesh, version
from pioneer_gazebo.world.model import (
    Box,
    Collision,
    Cylinder,
    Mesh,
    PlacedCollision,
    Plane,
    Shape,
    Sphere,
)
from pioneer_gazebo.world.pose import IDENTITY, Pose, conjugate, rotated

# Collision groups that Bullet does not assign itself: it puts every static body, walls included, into group 2.
STANDING, GROUND, ROLLING, ALL = 2, 64, 128, -1

SHAPES_AT_MOST = 16
"""Maximum number of shapes in a pybullet compound; it drops further ones silently."""

FRICTION_AT_MOST = 1.0
"""ODE uses the smaller friction coefficient of a pair, Bullet the product: so no coefficient may exceed 1."""

STEEPEST = 0.5
"""A triangle whose normal has a smaller upward component is a wall."""

_REGION = 4.0
"""Side [m] of the squares that shapes are sorted into, so that a batch holds neighbours."""


def batches(placed: Sequence[PlacedCollision]) -> Iterator[list[PlacedCollision]]:
    """Yields groups of shapes that fit in one body: neighbours with equal friction and restitution."""
    groups: dict[tuple[Any, ...], list[PlacedCollision]] = {}
    for one in placed:
        alone = id(one) if isinstance(one.collision.shape, Plane | Mesh) else 0
        groups.setdefault((one.collision.friction, one.collision.restitution, alone), []).append(
            one
        )
    for group in groups.values():
        group.sort(key=_region)
        for start in range(0, len(group), SHAPES_AT_MOST):
            yield group[start : start + SHAPES_AT_MOST]


def _region(one: PlacedCollision) -> tuple[int, int]:
    """Returns a sort key that walks the squares row by row, alternating direction."""
    x, y, _ = one.pose.position
    row = int(y // _REGION)
    column = int(x // _REGION)
    return row, column if row % 2 == 0 else -column


def packs(touches: Sequence[Touch]) -> list[list[Touch]]:
    """Groups shapes so that each group fits on one pybullet link: meshes and planes alone, others up to
    `SHAPES_AT_MOST`.
    """
    alone = [[one] for one in touches if isinstance(one.collision.shape, Mesh | Plane)]
    others = [one for one in touches if not isinstance(one.collision.shape, Mesh | Plane)]
    return [
        others[start : start + SHAPES_AT_MOST] for start in range(0, len(others), SHAPES_AT_MOST)
    ] + alone


def compound(shapes: Sequence[tuple[Collision, Pose]], client: int) -> int:
    """Returns a pybullet collision shape of ``shapes`` (see `packs`), of which a mesh becomes its hull; -1 for none.

    Args:
        shapes: each with its pose in the part or body.
        client: pybullet's physics client.

    Raises:
        EngineError: pybullet rejects a shape.
    """
    if not shapes:
        return -1
    try:
        if isinstance(shapes[0][0].shape, Mesh | Plane):
            return _lone(shapes[0][0].shape, shapes[0][1], client)
        return _array(shapes, client)
    except pybullet.error as error:
        names = ", ".join(collision.name for collision, _ in shapes)
        raise EngineError(
            f"the physics engine refuses the collision shape of {names}: {error}"
        ) from error


def _lone(shape: Mesh | Plane, pose: Pose, client: int) -> int:
    options: dict[str, Any] = (
        {"shapeType": pybullet.GEOM_PLANE, "planeNormal": shape.normal}
        if isinstance(shape, Plane)
        else {"shapeType": pybullet.GEOM_MESH, "vertices": hull_of_mesh(shape).tolist()}
    )
    return pybullet.createCollisionShape(
        collisionFramePosition=pose.position,
        collisionFrameOrientation=pose.rotation,
        physicsClientId=client,
        **options,
    )


class MeshShapes:
    """Concave shapes of static meshes; bodies with the same mesh share one shape."""

    def __init__(self, client: int) -> None:
        self.client = client
        self._made: dict[tuple[Any, ...], int] = {}

    def of(self, mesh: Mesh, up: NDArray[np.float64] | None = None) -> int:
        """Returns pybullet's id of a mesh's shape, or of its triangles that face ``up``; -1 if there are none.

        Raises:
            EngineError: pybullet rejects it.
        """
        key = mesh, version(mesh.path), None if up is None else tuple(np.round(up, 3))
        if key not in self._made:
            triangles = solid_of_mesh(mesh)
            if up is not None:
                normals = np.cross(
                    triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
                )
                lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
                triangles = triangles[np.abs(normals @ up) > STEEPEST * lengths]
            self._made[key] = self._shape(mesh.path, triangles) if len(triangles) else -1
        return self._made[key]

    def _shape(self, path: str, triangles: NDArray[np.float64]) -> int:
        corners, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
        try:
            return pybullet.createCollisionShape(
                pybullet.GEOM_MESH, vertices=corners.tolist(), indices=index.ravel().tolist(),
                flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH, physicsClientId=self.client,
            )  # fmt: skip
        except pybullet.error as error:
            raise EngineError(f"the physics engine refuses mesh {path}: {error}") from error


def _array(shapes: Sequence[tuple[Collision, Pose]], client: int) -> int:
    kinds, radii, halves, lengths = zip(
        *(_primitive(collision.shape) for collision, _ in shapes), strict=True
    )
    return pybullet.createCollisionShapeArray(
        shapeTypes=kinds,
        radii=radii,
        halfExtents=halves,
        lengths=lengths,
        collisionFramePositions=[pose.position for _, pose in shapes],
        collisionFrameOrientations=[pose.rotation for _, pose in shapes],
        physicsClientId=client,
    )


def _primitive(shape: Shape) -> tuple[int, float, list[float], float]:
    """Returns pybullet's shape type, radius, half extents and length."""
    match shape:
        case Box(size=size):
            return pybullet.GEOM_BOX, 0.0, [side / 2 for side in size], 0.0
        case Cylinder(radius=radius, length=length):
            return pybullet.GEOM_CYLINDER, radius, [0.0] * 3, length
        case Sphere(radius=radius):
            return pybullet.GEOM_SPHERE, radius, [0.0] * 3, 0.0
    raise AssertionError(f"{shape} is never one of several shapes")


def standing_body(batch: Sequence[PlacedCollision], meshes: MeshShapes) -> int:
    """Makes one fixed body of a batch and returns its pybullet handle.

    Raises:
        EngineError: see `compound`.
    """
    alone = len(batch) == 1
    base, mesh = batch[0].pose if alone else IDENTITY, batch[0].collision.shape
    if isinstance(mesh, Mesh):
        return fixed_body(meshes.of(mesh), base, batch[0].collision, meshes.client)
    shape = compound(
        [(one.collision, IDENTITY if alone else one.pose) for one in batch], meshes.client
    )
    return fixed_body(shape, base, batch[0].collision, meshes.client)


def fixed_body(shape: int, base: Pose, surface: Collision, client: int) -> int:
    """Makes a fixed body of a shape, with the friction and restitution of ``surface``; returns its pybullet handle."""
    body = pybullet.createMultiBody(
        baseMass=0.0, baseCollisionShapeIndex=shape, basePosition=base.position, baseOrientation=base.rotation,
        physicsClientId=client,
    )  # fmt: skip
    friction = min(surface.friction, FRICTION_AT_MOST)
    pybullet.changeDynamics(
        body, -1, lateralFriction=friction, restitution=surface.restitution, physicsClientId=client
    )
    return body


THICKNESS = 0.02
"""Thickness of a slab [m]."""

NARROWEST = 0.2
"""Minimum width of a top that carries wheels [m]."""

UPRIGHT = 0.9


def carriers(placed: Sequence[PlacedCollision], meshes: MeshShapes) -> list[int]:
    """Creates fixed bodies for the tops of obstacles, which wheels roll on; returns their pybullet handles.

    A wheel is a ball wider than the real wheel, so it must not collide with an obstacle's sides: thin slabs, or a
    mesh's upward-facing triangles, stand for the tops and collide with wheels only.
    """
    slabs = [slab for one in placed if (slab := _slab(one)) is not None]
    made = [standing_body(batch, meshes) for batch in batches(slabs)]
    for one in placed:
        if isinstance(one.collision.shape, Mesh):
            shape = meshes.of(one.collision.shape, one.pose.matrix()[2, :3])
            if shape >= 0:
                made.append(fixed_body(shape, one.pose, one.collision, meshes.client))
    for body in made:
        pybullet.setCollisionFilterGroupMask(
            body, -1, GROUND, ROLLING, physicsClientId=meshes.client
        )
    return made


def _slab(one: PlacedCollision) -> PlacedCollision | None:
    """Returns the top of a box or upright cylinder; None for other shapes and for tops that are too narrow."""
    shape = one.collision.shape
    up = rotated(conjugate(one.pose.rotation), (0.0, 0.0, 1.0))
    if isinstance(shape, Box):
        axis, size = max(range(3), key=lambda index: abs(up[index])), list(shape.size)
    elif isinstance(shape, Cylinder) and abs(up[2]) >= UPRIGHT:
        axis, size = 2, [2 * shape.radius, 2 * shape.radius, shape.length]
    else:
        return None
    if min(size[:axis] + size[axis + 1 :]) < NARROWEST:
        return None
    height, size[axis] = size[axis], min(THICKNESS, size[axis])
    top = (
        Box((size[0], size[1], size[2]))
        if isinstance(shape, Box)
        else Cylinder(shape.radius, size[2])
    )
    offset = [0.0, 0.0, 0.0]
    offset[axis] = (height - size[axis]) / 2 * (1.0 if up[axis] > 0 else -1.0)
    pose = one.pose.compose(Pose((offset[0], offset[1], offset[2])))
    return replace(one, collision=replace(one.collision, shape=top), pose=pose)
