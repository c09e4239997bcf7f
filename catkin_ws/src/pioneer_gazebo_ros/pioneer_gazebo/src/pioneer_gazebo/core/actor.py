"""Scripted models in the engine: led along their scripts, whatever stands in their way."""

import math

from pioneer_gazebo.core.engine import STILL, Engine, Velocity
from pioneer_gazebo.core.entity import Entity
from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.core.schedule import TICK_RATE
from pioneer_gazebo.core.script import Script

FASTEST = 10.0
"""A script that moves faster than this [m/s], as from its end back to its beginning, leaps: it pushes nothing away."""


class Actors:
    """All that follows a script. Where each is depends on the tick alone."""

    def __init__(self, engine: Engine) -> None:
        """Takes what pushes others out of their way."""
        self._engine = engine
        self._entities: list[Entity] = []

    def add(self, entity: Entity, script: Script, tick: int) -> None:
        """Has an entity follow a script that begins at ``tick``."""
        # Physics has no say in where it is: it never sleeps.
        entity.script, entity.began, entity.at_rest = script, tick, True
        self._entities.append(entity)

    def remove(self, entity: Entity) -> None:
        """Forgets an entity, whether it follows a script or not."""
        self._entities = [one for one in self._entities if one is not entity]

    def lead(self, following: int, step: float) -> None:
        """Has each move during the coming step [s] to where it is at the tick ``following``."""
        for entity in self._entities:
            entity.motion = velocity_between(entity.after, _pose(entity, following), step)
            self._engine.lead(entity.handle, entity.after, entity.motion)

    def follow(self, tick: int) -> None:
        """Notes where each is after a step that ended at ``tick``."""
        for entity in self._entities:
            entity.after, entity.seen = _pose(entity, tick), tick

    def restart(self, tick: int) -> None:
        """Restarts every script at ``tick``."""
        for entity in self._entities:
            entity.began, entity.seen, entity.motion = tick, tick, STILL
            entity.before = entity.after = _pose(entity, tick)


def _pose(entity: Entity, tick: int) -> Pose:
    assert entity.script is not None, "actors have a script"
    return entity.script.pose((tick - entity.began) / TICK_RATE)


def velocity_between(a: Pose, b: Pose, seconds: float) -> Velocity:
    """Returns the velocity that takes ``a`` to ``b`` in so many ``seconds``; none where that is a leap."""
    x, y, z = ((q - p) / seconds for p, q in zip(a.position, b.position, strict=True))
    if math.hypot(x, y, z) > FASTEST:
        return STILL
    turn = Pose(rotation=b.rotation).compose(Pose(rotation=a.rotation).inverse()).rotation
    rate = math.copysign(2.0 / seconds, turn[3])
    return Velocity((x, y, z), (rate * turn[0], rate * turn[1], rate * turn[2]))
