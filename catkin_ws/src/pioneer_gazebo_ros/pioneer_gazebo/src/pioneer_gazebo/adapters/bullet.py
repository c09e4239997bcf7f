"""The physics engine: pybullet, headless or in its own window, behind core's `Engine`."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pybullet

from pioneer_gazebo.adapters.bullet_shape import FRICTION_AT_MOST, Triangles, batches, compound, packs, standing_body
from pioneer_gazebo.adapters.bullet_window import client_with_window
from pioneer_gazebo.core import joint as kinds
from pioneer_gazebo.core.body import LEAST_MASS, Body, Part
from pioneer_gazebo.core.engine import Contact, EngineError, Physics, Velocity
from pioneer_gazebo.core.pose import Pose, Vector, opposite, rotated
from pioneer_gazebo.core.world import Inertia, PlacedCollision

# Bits that Bullet does not give out by itself: 2 is its own for everything that stands, walls too.
_STANDING, _GROUND, _ROLLING, _ALL = 2, 64, 128, -1
_SLIGHT = Inertia(1e-6, 1e-6, 1e-6)
_BOTH_WANT = 0
"""Two bodies meet where each one's mask holds the other's group; pybullet starts with one of the two sufficing."""

_KINDS = {
    kinds.FIXED: pybullet.JOINT_FIXED,
    kinds.CONTINUOUS: pybullet.JOINT_REVOLUTE,
    kinds.REVOLUTE: pybullet.JOINT_REVOLUTE,
    kinds.PRISMATIC: pybullet.JOINT_PRISMATIC,
}


class BulletEngine:
    """See `Engine`. pybullet numbers a base -1 and its links from 0, here a base is part 0 and links follow."""

    def __init__(self, triangles: Triangles, physics: Physics | None = None, window: bool = False) -> None:
        """Opens a physics server in this process; ``triangles`` reads meshes; ``window`` shows pybullet's viewer.

        Raises:
            EngineError: there is no display for a window.
        """
        self._triangles = triangles
        self._client = client_with_window() if window else pybullet.connect(pybullet.DIRECT)
        self._bodies: dict[int, Body] = {}
        self._centres: dict[int, list[Pose]] = {}
        self._solid_links: dict[int, list[int]] = {}
        self._hosts: dict[int, list[int]] = {}
        self._resting: set[int] = set()
        self._ground: list[int] = []
        self._obstacles: list[int] = []
        self._ground_set: frozenset[int] = frozenset()
        self._fall: Vector = (0.0, 0.0, 0.0)
        self.configure(physics or Physics())

    def configure(self, physics: Physics) -> None:
        """See `Engine`."""
        x, y, z = (part * physics.step for part in physics.gravity)
        self._fall = x, y, z
        pybullet.setGravity(*physics.gravity, physicsClientId=self._client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=physics.step,
            numSolverIterations=physics.iterations,
            numSubSteps=1,
            deterministicOverlappingPairs=1,
            # A pyramid in the cone's place costs a fifth less and, at as many iterations, a tenth of the error of a
            # spin: the cone's direction is worked out anew in each of them and has not settled by the last.
            enableConeFriction=0,
            collisionFilterMode=_BOTH_WANT,
            physicsClientId=self._client,
        )

    def set_standing(self, ground: Sequence[PlacedCollision], obstacles: Sequence[PlacedCollision]) -> None:
        """See `Engine`."""
        made: list[int] = []
        try:
            made += [standing_body(batch, self._triangles, self._client) for batch in batches(ground)]
            count = len(made)
            made += [standing_body(batch, self._triangles, self._client) for batch in batches(obstacles)]
        except EngineError:
            self._remove(made)
            raise
        self._remove(self._ground + self._obstacles)
        self._ground, self._obstacles = made[:count], made[count:]
        for body in self._ground:
            pybullet.setCollisionFilterGroupMask(body, -1, _GROUND, _ALL, physicsClientId=self._client)
        self._ground_set = frozenset(self._ground)

    def _remove(self, bodies: Sequence[int]) -> None:
        for body in bodies:
            pybullet.removeBody(body, physicsClientId=self._client)

    def add(self, body: Body, pose: Pose) -> int:
        """See `Engine`."""
        parts, hosts = spread(body.parts)
        shapes = [self._shape(part) for part in parts]
        base, links = parts[0], parts[1:]
        start = pose.compose(base.inertia.pose)
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
            physicsClientId=self._client,
        )
        if handle < 0:
            raise EngineError(f"the physics engine refuses body {body.name}")
        self._bodies[handle] = body
        self._centres[handle] = [part.inertia.pose.inverse() for part in body.parts]
        self._hosts[handle] = hosts
        solid = [] if body.led else [index - 1 for index, part in enumerate(parts) if not _rolls(part)]
        self._solid_links[handle] = solid
        for index, part in enumerate(parts):
            self._finish(handle, index - 1, part)
        if body.led:
            pybullet.setCollisionFilterGroupMask(
                handle, -1, 1, _ALL & ~(_STANDING | _GROUND), physicsClientId=self._client
            )
        pybullet.resetBasePositionAndOrientation(handle, start.position, start.rotation, physicsClientId=self._client)
        return handle

    def _shape(self, part: Part) -> int:
        shapes = [(touch.collision, touch.collision.pose) for touch in part.touches]
        return compound(shapes, self._triangles, True, self._client)

    def _finish(self, handle: int, link: int, part: Part) -> None:
        """Sets what `createMultiBody` has no argument for."""
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
            if joint.kind != kinds.CONTINUOUS and math.isfinite(joint.lower) and math.isfinite(joint.upper):
                options |= {"jointLowerLimit": joint.lower, "jointUpperLimit": joint.upper}
        pybullet.changeDynamics(handle, link, physicsClientId=self._client, **options)
        if joint is not None and joint.kind != kinds.FIXED:
            # pybullet starts with a motor in every joint; what is left of it is the joint's friction.
            pybullet.setJointMotorControl2(
                handle, link, pybullet.VELOCITY_CONTROL, targetVelocity=0.0, force=joint.friction,
                physicsClientId=self._client,
            )  # fmt: skip
        if part.touches and _rolls(part):
            pybullet.setCollisionFilterGroupMask(handle, link, _ROLLING, _GROUND, physicsClientId=self._client)

    def remove(self, handle: int) -> None:
        """See `Engine`."""
        del self._bodies[handle], self._centres[handle], self._solid_links[handle], self._hosts[handle]
        self._resting.discard(handle)
        pybullet.removeBody(handle, physicsClientId=self._client)

    def step(self) -> None:
        """See `Engine`."""
        pybullet.stepSimulation(physicsClientId=self._client)

    def pose(self, handle: int, part: int = 0) -> Pose:
        """See `Engine`."""
        if part:
            state = pybullet.getLinkState(handle, part - 1, 0, 1, physicsClientId=self._client)
            return Pose(state[4], state[5])
        position, rotation = pybullet.getBasePositionAndOrientation(handle, physicsClientId=self._client)
        return Pose(position, rotation).compose(self._centres[handle][0])

    def velocity(self, handle: int, part: int = 0) -> Velocity:
        """See `Engine`."""
        if part:
            state = pybullet.getLinkState(handle, part - 1, 1, 1, physicsClientId=self._client)
            rotation, linear, angular = state[1], state[6], state[7]
        else:
            _, rotation = pybullet.getBasePositionAndOrientation(handle, physicsClientId=self._client)
            linear, angular = pybullet.getBaseVelocity(handle, physicsClientId=self._client)
        return Velocity(linear, angular).at(rotated(rotation, self._centres[handle][part].position))

    def set_pose(self, handle: int, pose: Pose) -> None:
        """See `Engine`."""
        self._wake(handle)
        velocity = pybullet.getBaseVelocity(handle, physicsClientId=self._client)
        centre = pose.compose(self._bodies[handle].parts[0].inertia.pose)
        pybullet.resetBasePositionAndOrientation(handle, centre.position, centre.rotation, physicsClientId=self._client)
        pybullet.resetBaseVelocity(handle, *velocity, physicsClientId=self._client)

    def set_velocity(self, handle: int, velocity: Velocity) -> None:
        """See `Engine`."""
        self._wake(handle)
        _, rotation = pybullet.getBasePositionAndOrientation(handle, physicsClientId=self._client)
        centre = velocity.at(opposite(rotated(rotation, self._centres[handle][0].position)))
        pybullet.resetBaseVelocity(handle, centre.linear, centre.angular, physicsClientId=self._client)

    def lead(self, handle: int, pose: Pose, velocity: Velocity) -> None:
        """See `Engine`. What gravity will add during the step is taken off before."""
        x, y, z = (v - fall for v, fall in zip(velocity.linear, self._fall, strict=True))
        pybullet.resetBasePositionAndOrientation(handle, pose.position, pose.rotation, physicsClientId=self._client)
        pybullet.resetBaseVelocity(handle, (x, y, z), velocity.angular, physicsClientId=self._client)

    def joints(self, handle: int, parts: Sequence[int]) -> list[tuple[float, float]]:
        """See `Engine`."""
        states = pybullet.getJointStates(handle, [part - 1 for part in parts], physicsClientId=self._client)
        return [(state[0], state[1]) for state in states]

    def efforts(self, handle: int, parts: Sequence[int]) -> list[float]:
        """See `Engine`."""
        states = pybullet.getJointStates(handle, [part - 1 for part in parts], physicsClientId=self._client)
        return [state[3] for state in states]

    def set_joint(self, handle: int, part: int, position: float) -> None:
        """See `Engine`."""
        self._wake(handle)
        pybullet.resetJointState(handle, part - 1, position, 0.0, physicsClientId=self._client)

    def turn(self, handle: int, parts: Sequence[int], speeds: Sequence[float], efforts: Sequence[float]) -> None:
        """See `Engine`."""
        pybullet.setJointMotorControlArray(
            handle, [part - 1 for part in parts], pybullet.VELOCITY_CONTROL, targetVelocities=speeds, forces=efforts,
            physicsClientId=self._client,
        )  # fmt: skip

    def rest(self, handle: int, allowed: bool) -> None:
        """See `Engine`."""
        if allowed:
            self._resting.add(handle)
            self._activate(handle, pybullet.ACTIVATION_STATE_ENABLE_SLEEPING)
        else:
            self._wake(handle)
            self._resting.discard(handle)
            self._activate(handle, pybullet.ACTIVATION_STATE_DISABLE_SLEEPING)

    def _activate(self, handle: int, state: int) -> None:
        pybullet.changeDynamics(handle, -1, activationState=state, physicsClientId=self._client)

    def _wake(self, handle: int) -> None:
        if handle in self._resting:
            self._activate(handle, pybullet.ACTIVATION_STATE_WAKE_UP)

    def push(self, handle: int, part: int, force: Vector, torque: Vector, point: Vector) -> None:
        """See `Engine`."""
        self._wake(handle)
        frame, client = pybullet.WORLD_FRAME, self._client
        pybullet.applyExternalForce(handle, part - 1, force, point, frame, physicsClientId=client)
        pybullet.applyExternalTorque(handle, part - 1, torque, frame, physicsClientId=client)

    def contacts(self, handle: int) -> list[Contact]:
        """See `Engine`."""
        points = pybullet.getContactPoints(bodyA=handle, physicsClientId=self._client)
        return [self._contact(point) for point in points if point[2] not in self._ground_set]

    def _contact(self, point: tuple[Any, ...]) -> Contact:
        other = point[2] if point[2] in self._bodies else None
        part = self._hosts[other][point[4] + 1] if other is not None else 0
        return Contact(self._hosts[point[1]][point[3] + 1], other, part, point[6], point[7], -point[8], point[9])

    def touching(self) -> set[int]:
        """See `Engine`.

        Asked by links, because what rolls meets the ground only, and each contact point that comes over costs 6 µs.
        """
        return {
            handle for handle, links in self._solid_links.items() if any(self._is_touched(handle, one) for one in links)
        }

    def _is_touched(self, handle: int, link: int) -> bool:
        points = pybullet.getContactPoints(bodyA=handle, linkIndexA=link, physicsClientId=self._client)
        return any(point[9] > 0.0 and point[2] not in self._ground_set for point in points)

    def overlap(self, handle: int) -> list[Contact]:
        """See `Engine`."""
        pybullet.performCollisionDetection(physicsClientId=self._client)
        return [contact for contact in self.contacts(handle) if contact.depth > 0.0]

    def close(self) -> None:
        """See `Engine`."""
        pybullet.disconnect(self._client)


def spread(parts: Sequence[Part]) -> tuple[list[Part], list[int]]:
    """Returns parts whose shapes pybullet takes, and of each the index of the part it belongs to.

    What one link cannot hold is put into further parts, held to theirs by fixed joints and as good as without mass.
    """
    first: list[Part] = []
    more: list[Part] = []
    hosts: list[int] = []
    for index, part in enumerate(parts):
        groups = packs(part.touches)
        first.append(replace(part, touches=tuple(groups[0]) if groups else ()))
        for group in groups[1:]:
            joint = kinds.Joint("", kinds.FIXED, part.name, part.name)
            more.append(Part(part.name, index, joint, LEAST_MASS, _SLIGHT, tuple(group), ()))
            hosts.append(index)
    return first + more, [*range(len(first)), *hosts]


def _rolls(part: Part) -> bool:
    """Tells whether a part meets nothing but the ground: it only rolls there, or has no shape at all."""
    return all(touch.rolling for touch in part.touches)


def _joint(part: Part) -> kinds.Joint:
    assert part.joint is not None, "only a base has no joint"
    return part.joint
