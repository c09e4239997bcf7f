"""The static world: static models, divided into ground and obstacles."""

from dataclasses import replace

from pioneer_gazebo.core.body import heights
from pioneer_gazebo.core.bound import check_placed
from pioneer_gazebo.core.engine import Engine
from pioneer_gazebo.core.nearest import nearest, scoped_name
from pioneer_gazebo.core.pose import Pose, Vector
from pioneer_gazebo.core.scene import Scene
from pioneer_gazebo.core.section import Triangles
from pioneer_gazebo.core.world import Model, PlacedCollision, Plane, World

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
            (ground if is_ground(one, self._triangles) else obstacles).append(one)
        self._engine.set_standing(ground, obstacles)
        self._scene.set_standing(obstacles)
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
        found = nearest(self._obstacles, point)
        return scoped_name(found) if found is not None else "the world"


def is_ground(one: PlacedCollision, triangles: Triangles) -> bool:
    """Returns whether a static shape is ground."""
    shape = one.collision.shape
    return isinstance(shape, Plane) or heights(shape, one.pose, triangles)[1] <= GROUND_TOP
