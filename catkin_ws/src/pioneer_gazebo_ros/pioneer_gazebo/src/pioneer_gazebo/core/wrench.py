"""Forces and torques applied to bodies for a limited time."""

from dataclasses import dataclass

from pioneer_gazebo.core.engine import Engine
from pioneer_gazebo.core.entity import Entity
from pioneer_gazebo.core.pose import Vector


@dataclass(frozen=True, slots=True, eq=False)
class Wrench:
    """A force [N] at a point of a part and a torque [N m], in the world's axes, from one tick to another."""

    entity: Entity
    part: int
    force: Vector
    torque: Vector
    point: Vector
    first: int
    last: float


class Wrenches:
    """All active and pending wrenches."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._wrenches: list[Wrench] = []

    def add(self, wrench: Wrench) -> None:
        """Adds a wrench."""
        self._wrenches.append(wrench)

    def clear(self, entity: Entity | None = None, part: int | None = None) -> None:
        """Ends all wrenches, those on an entity, or those on one of its parts."""
        self._wrenches = [
            one for one in self._wrenches if not (entity in (None, one.entity) and part in (None, one.part))
        ]

    def push(self, tick: int) -> None:
        """Applies the active wrenches to the step that begins at ``tick``, and removes those that have ended."""
        if self._wrenches:
            self._wrenches = [one for one in self._wrenches if one.last > tick]
        for one in self._wrenches:
            if one.first <= tick:
                self._engine.push(one.entity.handle, one.part, one.force, one.torque, one.point)
