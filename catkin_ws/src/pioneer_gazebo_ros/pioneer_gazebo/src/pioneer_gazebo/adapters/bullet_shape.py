"""Collision shapes in pybullet: individual ones for bodies, batches for the static world."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.adapters.mesh import hull_of_mesh, solid_of_mesh, version
from pioneer_gazebo.adapters.quiet_pybullet import pybullet
from pioneer_gazebo.core.engine import EngineError
from pioneer_gazebo.core.pose import IDENTITY, Pose
from pioneer_gazebo.core.wheel import Touch
from pioneer_gazebo.core.world import Box, Collision, Cylinder, Mesh, PlacedCollision, Plane, Sphere

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
        groups.setdefault((one.collision.friction, one.collision.restitution, alone), []).append(one)
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
    return [others[start : start + SHAPES_AT_MOST] for start in range(0, len(others), SHAPES_AT_MOST)] + alone


def compound(shapes: Sequence[tuple[Collision, Pose]], moving: bool, client: int) -> int:
    """Returns a pybullet collision shape of all ``shapes``; -1 for none.

    Args:
        shapes: each with its pose in the part or body.
        moving: whether a mesh becomes its convex hull; otherwise it stays concave.
        client: pybullet's physics client.

    Raises:
        EngineError: pybullet rejects a shape, or a mesh is one of several.
    """
    if not shapes:
        return -1
    if len(shapes) > SHAPES_AT_MOST:
        raise EngineError(f"a link has {len(shapes)} collision shapes; at most {SHAPES_AT_MOST} are supported")
    try:
        if any(isinstance(collision.shape, Mesh | Plane) for collision, _ in shapes):
            return _lone(shapes, moving, client)
        return _array(shapes, client)
    except pybullet.error as error:
        names = ", ".join(collision.name for collision, _ in shapes)
        raise EngineError(f"the physics engine refuses the collision shape of {names}: {error}") from error


def _lone(shapes: Sequence[tuple[Collision, Pose]], moving: bool, client: int) -> int:
    if len(shapes) > 1:
        raise EngineError(f"collision {shapes[0][0].name}: a mesh or plane has to be the only shape of its link")
    collision, pose = shapes[0]
    options: dict[str, Any] = {"collisionFramePosition": pose.position, "collisionFrameOrientation": pose.rotation}
    if isinstance(collision.shape, Plane):
        return pybullet.createCollisionShape(
            pybullet.GEOM_PLANE, planeNormal=collision.shape.normal, physicsClientId=client, **options
        )
    assert isinstance(collision.shape, Mesh)
    assert moving, "standing meshes are MeshShapes"
    corners = hull_of_mesh(collision.shape)
    return pybullet.createCollisionShape(
        pybullet.GEOM_MESH, vertices=corners.tolist(), physicsClientId=client, **options
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
                normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
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
    kinds, radii, halves, lengths = [], [], [], []
    for collision, _ in shapes:
        kind, radius, half, length = _primitive(collision)
        kinds.append(kind)
        radii.append(radius)
        halves.append(half)
        lengths.append(length)
    return pybullet.createCollisionShapeArray(
        shapeTypes=kinds,
        radii=radii,
        halfExtents=halves,
        lengths=lengths,
        collisionFramePositions=[pose.position for _, pose in shapes],
        collisionFrameOrientations=[pose.rotation for _, pose in shapes],
        physicsClientId=client,
    )


def _primitive(collision: Collision) -> tuple[int, float, list[float], float]:
    """Returns pybullet's shape type, radius, half extents and length."""
    match collision.shape:
        case Box(size=size):
            return pybullet.GEOM_BOX, 0.0, [side / 2 for side in size], 0.0
        case Cylinder(radius=radius, length=length):
            return pybullet.GEOM_CYLINDER, radius, [0.0] * 3, length
        case Sphere(radius=radius):
            return pybullet.GEOM_SPHERE, radius, [0.0] * 3, 0.0
        case shape:
            raise EngineError(f"collision {collision.name}: {type(shape).__name__} cannot be one of several shapes")


def standing_body(batch: Sequence[PlacedCollision], meshes: MeshShapes) -> int:
    """Makes one fixed body of a batch and returns its pybullet handle.

    Raises:
        EngineError: see `compound`.
    """
    alone = len(batch) == 1
    base, mesh = batch[0].pose if alone else IDENTITY, batch[0].collision.shape
    if isinstance(mesh, Mesh):
        return fixed_body(meshes.of(mesh), base, batch[0].collision, meshes.client)
    shape = compound([(one.collision, IDENTITY if alone else one.pose) for one in batch], False, meshes.client)
    return fixed_body(shape, base, batch[0].collision, meshes.client)


def fixed_body(shape: int, base: Pose, surface: Collision, client: int) -> int:
    """Makes a fixed body of a shape, with the friction and restitution of ``surface``; returns its pybullet handle."""
    body = pybullet.createMultiBody(
        baseMass=0.0, baseCollisionShapeIndex=shape, basePosition=base.position, baseOrientation=base.rotation,
        physicsClientId=client,
    )  # fmt: skip
    friction = min(surface.friction, FRICTION_AT_MOST)
    pybullet.changeDynamics(body, -1, lateralFriction=friction, restitution=surface.restitution, physicsClientId=client)
    return body
