"""Builds pybullet multibodies: a tree of parts becomes a base and links."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from pioneer_gazebo.body.body import LEAST_MASS, Body, Part
from pioneer_gazebo.physics.bullet_shape import (
    ALL,
    FRICTION_AT_MOST,
    GROUND,
    ROLLING,
    STANDING,
    compound,
    packs,
)
from pioneer_gazebo.physics.engine import EngineError
from pioneer_gazebo.physics.quiet_pybullet import pybullet
from pioneer_gazebo.world import joint as kinds
from pioneer_gazebo.world.model import Inertia
from pioneer_gazebo.world.pose import Pose

UNLIMITED = 1e9
"""Limit of a joint on a side without one [rad or m]."""

STRONGEST_STOP = 1e9
"""Force by which a joint is held at its limit [N or N m]."""

_SLIGHT = Inertia(1e-6, 1e-6, 1e-6)
_KINDS = {
    kinds.FIXED: pybullet.JOINT_FIXED,
    kinds.CONTINUOUS: pybullet.JOINT_REVOLUTE,
    kinds.REVOLUTE: pybullet.JOINT_REVOLUTE,
    kinds.PRISMATIC: pybullet.JOINT_PRISMATIC,
}


@dataclass(frozen=True, slots=True)
class Made:
    """A body in the engine. pybullet numbers a base -1 and its links from 0."""

    body: Body  #: the description it was made from
    centres: list[Pose]  #: of each part: the part's frame relative to its centre of mass
    links: list[int]  #: pybullet's link index of each part
    hosts: list[int]  #: the part of each pybullet link, base first
    solid: list[int]  #: pybullet's indices of links that collide with more than the ground
    #: pybullet's index, lower and upper limit [rad or m] of joints with limits
    bounded: list[tuple[int, float, float]] = field(default_factory=list)


def make_body(body: Body, pose: Pose, client: int) -> tuple[int, Made]:
    """Creates a body at rest with its base frame at ``pose``; returns its pybullet handle.

    Raises:
        EngineError: pybullet rejects it.
    """
    parts, hosts = spread(body.parts)
    shapes = [compound([(t.collision, t.collision.pose) for t in p.touches], client) for p in parts]
    base, links = parts[0], parts[1:]
    handle = pybullet.createMultiBody(
        baseMass=base.mass,
        baseCollisionShapeIndex=shapes[0],
        basePosition=pose.position,
        baseOrientation=pose.rotation,
        baseInertialFramePosition=base.inertia.pose.position,
        baseInertialFrameOrientation=base.inertia.pose.rotation,
        linkMasses=[part.mass for part in links],
        linkCollisionShapeIndices=shapes[1:],
        linkVisualShapeIndices=[-1] * len(links),
        linkPositions=[_joint(part).pose.position for part in links],
        linkOrientations=[_joint(part).pose.rotation for part in links],
        linkInertialFramePositions=[part.inertia.pose.position for part in links],
        linkInertialFrameOrientations=[part.inertia.pose.rotation for part in links],
        linkParentIndices=[part.parent for part in links],
        linkJointTypes=[_KINDS[_joint(part).kind] for part in links],
        linkJointAxis=[_joint(part).axis for part in links],
        physicsClientId=client,
    )
    if handle < 0:
        raise EngineError(f"the physics engine refuses body {body.name}")
    for index, part in enumerate(parts):
        _finish(handle, index - 1, part, client)
    if body.led:
        pybullet.setCollisionFilterGroupMask(
            handle, -1, 1, ALL & ~(STANDING | GROUND), physicsClientId=client
        )
    start = pose.compose(base.inertia.pose)
    pybullet.resetBasePositionAndOrientation(
        handle, start.position, start.rotation, physicsClientId=client
    )
    return handle, Made(
        body,
        [part.inertia.pose.inverse() for part in body.parts],
        [hosts.index(number) - 1 for number in range(len(body.parts))],
        hosts,
        [] if body.led else [index - 1 for index, part in enumerate(parts) if not _rolls(part)],
        [
            (index - 1, _joint(part).lower, _joint(part).upper)
            for index, part in enumerate(parts)
            if is_bounded(part)
        ],
    )


def spread(parts: Sequence[Part]) -> tuple[list[Part], list[int]]:
    """Splits parts into links that pybullet accepts; returns them and, for each, the index of its original part.

    Shapes that do not fit on one link go to extra links of negligible mass, attached by fixed joints. These directly
    follow their part, because pybullet numbers links depth first, whatever order they are given in.
    """
    made: list[Part] = []
    hosts: list[int] = []
    first: dict[int, int] = {-1: -1}
    for index, part in enumerate(parts):
        groups = packs(part.touches)
        first[index] = len(made)
        made.append(
            replace(part, parent=first[part.parent], touches=tuple(groups[0]) if groups else ())
        )
        joint = kinds.Joint("", kinds.FIXED, part.name, part.name)
        made += [
            Part(part.name, first[index], joint, LEAST_MASS, _SLIGHT, tuple(one), ())
            for one in groups[1:]
        ]
        hosts += [index] * max(1, len(groups))
    return made, hosts


def _rolls(part: Part) -> bool:
    """Returns whether a part collides with the ground only: all its shapes roll, or it has none."""
    return all(touch.rolling for touch in part.touches)


def is_bounded(part: Part) -> bool:
    """Returns whether the joint that moves a part has limits."""
    joint = part.joint
    if joint is None or joint.kind in (kinds.FIXED, kinds.CONTINUOUS):
        return False
    return math.isfinite(joint.lower) or math.isfinite(joint.upper)


def _joint(part: Part) -> kinds.Joint:
    assert part.joint is not None, "only a base has no joint"
    return part.joint


def _finish(handle: int, link: int, part: Part, client: int) -> None:
    """Sets the properties that `createMultiBody` has no argument for."""
    frictions = [touch.collision.friction for touch in part.touches]
    options: dict[str, Any] = {
        "lateralFriction": min([FRICTION_AT_MOST, *frictions]),
        "restitution": max([0.0, *(touch.collision.restitution for touch in part.touches)]),
        "linearDamping": 0.0,
        "angularDamping": 0.0,
    }
    if part.mass > 0:
        options["localInertiaDiagonal"] = (part.inertia.ixx, part.inertia.iyy, part.inertia.izz)
    joint = part.joint
    if joint is not None and joint.kind != kinds.FIXED:
        options["jointDamping"] = joint.damping
        if is_bounded(part):
            options["jointLowerLimit"] = max(joint.lower, -UNLIMITED)
            options["jointUpperLimit"] = min(joint.upper, UNLIMITED)
            # By default 100 N, through which a heavier load falls.
            options["jointLimitForce"] = STRONGEST_STOP
    pybullet.changeDynamics(handle, link, physicsClientId=client, **options)
    if joint is not None and joint.kind != kinds.FIXED:
        # pybullet puts a motor into every joint; its force is reduced to the joint's friction.
        pybullet.setJointMotorControl2(
            handle,
            link,
            pybullet.VELOCITY_CONTROL,
            targetVelocity=0.0,
            force=joint.friction,
            physicsClientId=client,
        )
    if part.touches and _rolls(part):
        pybullet.setCollisionFilterGroupMask(handle, link, ROLLING, GROUND, physicsClientId=client)
