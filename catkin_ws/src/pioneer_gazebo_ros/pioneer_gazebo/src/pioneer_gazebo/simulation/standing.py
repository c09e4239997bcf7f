"""The static world: static models, divided into ground and obstacles."""

import math
from dataclasses import replace

from pioneer_gazebo.body.body import heights
from pioneer_gazebo.physics.bound import check_placed
from pioneer_gazebo.physics.engine import Engine
from pioneer_gazebo.simulation.scene import Scene
from pioneer_gazebo.world.model import (
    Box,
    Cylinder,
    Model,
    PlacedCollision,
    Plane,
    Shape,
    Sphere,
    World,
)
from pioneer_gazebo.world.pose import Pose, Vector
from pioneer_gazebo.world.section import Triangles

GROUND_TOP = 0.03
"""Maximum top height [m] of static shapes that count as ground: wheels roll on it, touching it is no collision."""


class Standing:
    """Static models by name; changes are passed to engine and scene."""

    def __init__(self, engine: Engine, scene: Scene, triangles: Triangles) -> None:
        self._engine, self._scene, self._triangles = engine, scene, triangles
        self._first: dict[str, Model] = {}
        self._obstacles: list[PlacedCollision] = []
        self.models: dict[str, Model] = {}

    def _set(self, models: dict[str, Model]) -> None:
        placed = list(World("", tuple(models.values())).collisions())
        check_placed(placed)
        ground: list[PlacedCollision] = []
        obstacles: list[PlacedCollision] = []
        for one in placed:
            shape = one.collision.shape
            is_ground = (
                isinstance(shape, Plane)
                or heights(shape, one.pose, self._triangles)[1] <= GROUND_TOP
            )
            (ground if is_ground else obstacles).append(one)
        self._engine.set_standing(ground, obstacles)
        self._scene.set_standing(ground, obstacles)
        self.models, self._obstacles = models, obstacles

    def add(self, *models: Model) -> None:
        """Adds static models; nothing changes if this fails.

        Raises:
            EngineError: a shape cannot be created.
            BoundError: a value is out of bounds.
        """
        added = {model.name: model for model in models}
        self._set({**self.models, **added})
        self._first |= added

    def remove(self, name: str) -> None:
        """Removes the model of that name."""
        self._set({key: model for key, model in self.models.items() if key != name})
        del self._first[name]

    def place(self, name: str, pose: Pose) -> None:
        """Moves the model of that name."""
        self._set({**self.models, name: replace(self.models[name], pose=pose)})

    def reset(self) -> None:
        """Moves every model back to the pose it was added with."""
        if self.models != self._first:
            self._set(dict(self._first))

    def name_at(self, point: Vector) -> str:
        """Returns ``model::link::collision`` of the obstacle nearest to a point."""
        if not self._obstacles:
            return "the world"
        one = min(
            self._obstacles, key=lambda one: distance_to(one.collision.shape, one.pose, point)
        )
        return f"{one.model.name}::{one.link.name}::{one.collision.name}"


def distance_to(shape: Shape, pose: Pose, point: Vector) -> float:
    """Returns the distance [m] from a point to a shape, 0 inside; for a mesh, to its origin."""
    x, y, z = pose.inverse().transform(point)
    match shape:
        case Box(size=size):
            return math.hypot(
                *(max(0.0, abs(v) - s / 2) for v, s in zip((x, y, z), size, strict=True))
            )
        case Cylinder(radius=radius, length=length):
            return math.hypot(max(0.0, math.hypot(x, y) - radius), max(0.0, abs(z) - length / 2))
        case Sphere(radius=radius):
            return max(0.0, math.hypot(x, y, z) - radius)
        case Plane(normal=(a, b, c)):
            return max(0.0, a * x + b * y + c * z)
        case _:
            return math.hypot(x, y, z)
