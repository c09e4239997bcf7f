"""Moves scripted models along their scripts, regardless of obstacles, and pushes bodies by forces and torques."""

import math
from dataclasses import dataclass

from pioneer_gazebo.physics.engine import STILL, Engine, Velocity
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.joint_motor import push_joint
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.world.model import Script
from pioneer_gazebo.world.pose import Pose, Vector, scaled

FASTEST = 10.0
"""Faster script motion [m/s], such as from its end back to its start, is a jump: the model pushes nothing away."""


class Actors:
    """All models that follow a script. The pose of each depends on the tick alone."""

    def __init__(self, engine: Engine) -> None:
        """Takes the engine, in which scripted models push other bodies aside."""
        self._engine = engine
        self._entities: list[Entity] = []

    def add(self, entity: Entity, script: Script, tick: int) -> None:
        """Makes an entity follow a script that begins at ``tick``."""
        # Its pose does not depend on physics, so it is never put to sleep.
        entity.script, entity.began, entity.at_rest = script, tick, True
        self._entities.append(entity)

    def remove(self, entity: Entity) -> None:
        """Removes an entity, whether or not it follows a script."""
        self._entities = [one for one in self._entities if one is not entity]

    def lead(self, following: int, step: float) -> None:
        """Sets each model's motion during the coming step [s] so that it ends at its pose at tick ``following``."""
        for entity in self._entities:
            entity.motion = velocity_between(entity.after, _pose(entity, following), step)
            self._engine.lead(entity.handle, entity.after, entity.motion)

    def follow(self, tick: int) -> None:
        """Records each model's pose after a step that ended at ``tick``."""
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
    """Returns the velocity that moves ``a`` to ``b`` in ``seconds``; zero if that is a jump."""
    x, y, z = ((q - p) / seconds for p, q in zip(a.position, b.position, strict=True))
    if math.hypot(x, y, z) > FASTEST:
        return STILL
    turn = Pose(rotation=b.rotation).compose(Pose(rotation=a.rotation).inverse()).rotation
    rate = math.copysign(2.0 / seconds, turn[3])
    return Velocity((x, y, z), (rate * turn[0], rate * turn[1], rate * turn[2]))


@dataclass(frozen=True, slots=True, eq=False)
class Wrench:
    """A force [N] on a part and a torque [N m], in the world's axes, from one tick to another.

    The force acts at ``point`` in the world or, for None, at the part's centre of mass, wherever that moves.

    The ticks may lie within a physics step: the impulse counts, which is force times duration.
    """

    entity: Entity
    part: int
    force: Vector
    torque: Vector
    point: Vector | None
    first: float
    last: float

    def push(self, engine: Engine, share: float) -> None:
        """Applies a ``share`` (0 … 1) of it in the next step."""
        force, torque = scaled(self.force, share), scaled(self.torque, share)
        engine.push(self.entity.handle, self.part, force, torque, self.point)


@dataclass(frozen=True, slots=True, eq=False)
class Effort:
    """A force [N] or torque [N m] along the joint that moves a part, from one tick to another."""

    entity: Entity
    part: int
    effort: float
    first: float
    last: float

    def push(self, engine: Engine, share: float) -> None:
        """Applies a ``share`` (0 … 1) of it in the next step, to the part and against its parent."""
        push_joint(engine, self.entity.handle, self.entity.body, self.part, share * self.effort)


def _share(push: Wrench | Effort, begin: int, end: int) -> float:
    """Returns the part (0 … 1) of the time between two ticks during which a push acts."""
    acts = min(push.last, end) - max(push.first, begin)
    return max(0.0, acts) / (end - begin)


class Wrenches:
    """All active and pending wrenches and efforts."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._wrenches: list[Wrench | Effort] = []

    def add(self, wrench: Wrench | Effort) -> None:
        """Adds a wrench or an effort."""
        self._wrenches.append(wrench)

    def clear(self, entity: Entity | None = None) -> None:
        """Ends all wrenches and efforts, or those on an entity."""
        self._wrenches = [one for one in self._wrenches if entity not in (None, one.entity)]

    def clear_part(self, kind: type[Wrench | Effort], entity: Entity, part: int) -> None:
        """Ends the wrenches, or the efforts, on a part."""
        self._wrenches = [
            one
            for one in self._wrenches
            if not (isinstance(one, kind) and one.entity is entity and one.part == part)
        ]

    def push(self, begin: int, end: int) -> None:
        """Applies the wrenches to the step from ``begin`` to ``end`` [ticks], and removes those that have ended.

        A wrench that acts during a part of the step gives its impulse over the whole of it.
        """
        if self._wrenches:
            self._wrenches = [one for one in self._wrenches if one.last > begin]
        for one in self._wrenches:
            share = _share(one, begin, end)
            if share > 0.0:
                one.push(self._engine, share)
