"""Motion of a body's parts, from the motion of its base and its joints."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from pioneer_gazebo.body.body import Body
from pioneer_gazebo.physics.engine import Velocity
from pioneer_gazebo.world import joint as kinds
from pioneer_gazebo.world.pose import Pose, Vector, added, opposite, rotated, scaled


class Motion(NamedTuple):
    """Pose and velocity of a frame in the world."""

    pose: Pose
    velocity: Velocity


class JointState(NamedTuple):
    """Position [rad or m] and speed [rad/s or m/s] of a joint."""

    position: float
    rate: float


def chain_to(body: Body, part: int) -> list[int]:
    """Returns the parts from the base, which is left out, to ``part``."""
    chain = []
    while part > 0:
        chain.append(part)
        part = body.parts[part].parent
    return chain[::-1]


def part_motion(
    body: Body, chain: Sequence[int], base: Motion, joints: Sequence[JointState]
) -> Motion:
    """Returns the motion of the frame of the last part of ``chain`` (that of the base for an empty one).

    Args:
        body: the body.
        chain: as returned by `chain_to`.
        base: motion of the body's base frame.
        joints: state of the joint that moves each part of ``chain``.
    """
    pose, velocity = base
    for part, (position, rate) in zip(chain, joints, strict=True):
        joint = body.parts[part].joint
        assert joint is not None, "only a base has no joint"
        frame = pose.compose(joint.pose)
        axis = rotated(frame.rotation, joint.axis)
        if joint.kind == kinds.PRISMATIC:
            child = frame.compose(Pose(scaled(joint.axis, position)))
            carried = velocity.at(added(child.position, opposite(pose.position)))
            velocity = Velocity(added(carried.linear, scaled(axis, rate)), carried.angular)
        else:
            child = frame.compose(Pose(rotation=_turn(joint.axis, position)))
            carried = velocity.at(added(child.position, opposite(pose.position)))
            velocity = Velocity(carried.linear, added(carried.angular, scaled(axis, rate)))
        pose = child
    return Motion(pose, velocity)


def interpolated(a: Velocity, b: Velocity, part: float) -> Velocity:
    """Interpolates linearly from ``a`` to ``b`` by ``part`` (0 … 1)."""
    return Velocity(_mixed(a.linear, b.linear, part), _mixed(a.angular, b.angular, part))


def _mixed(a: Vector, b: Vector, part: float) -> Vector:
    (ax, ay, az), (bx, by, bz) = a, b
    return ax + part * (bx - ax), ay + part * (by - ay), az + part * (bz - az)


def _turn(axis: Vector, angle: float) -> tuple[float, float, float, float]:
    half = 0.5 * angle
    x, y, z = scaled(axis, math.sin(half))
    return x, y, z, math.cos(half)
