"""Applies commands to a body before each step: turns wheels, moves bases, and lets bodies at rest sleep."""

from pioneer_gazebo.core.engine import Engine, Velocity
from pioneer_gazebo.core.entity import Entity


def control(engine: Engine, entity: Entity, tick: int, step: float) -> None:
    """Applies the commands an entity received by ``tick`` for the next ``step`` [s]."""
    for driven in entity.drives:
        driven.obey(tick)
    speeds = [driven.drive.wheel_speeds(step) for driven in entity.drives]
    at_rest = all(driven.drive.at_rest for driven in entity.drives)
    if entity.movers:
        at_rest = _move(engine, entity, tick) and at_rest
    if at_rest != entity.at_rest:
        entity.at_rest = at_rest
        engine.rest(entity.handle, at_rest)
    for driven, wanted in zip(entity.drives, speeds, strict=True):
        if wanted is not None:
            driven.turn(engine, wanted)


def _move(engine: Engine, entity: Entity, tick: int) -> bool:
    """Moves a base in the plane; returns whether it is to stand still."""
    fall = engine.velocity(entity.handle).linear[2]
    rotation = engine.pose(entity.handle).rotation
    motions = [mover.obey(tick, rotation, fall) for mover in entity.movers]
    motion = next((one for one in motions if one is not None), None)
    if motion is not None or not entity.at_rest:
        engine.set_velocity(entity.handle, motion or Velocity((0.0, 0.0, fall)))
    return motion is None
