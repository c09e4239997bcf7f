"""The physics engine: implements core's `Engine` with pybullet, headless or with its viewer."""

import math
import os
import socket
from collections.abc import Sequence
from typing import Any

from pioneer_gazebo.body.body import Body
from pioneer_gazebo.physics.bullet_body import Made, make_body
from pioneer_gazebo.physics.bullet_shape import (
    ALL,
    GROUND,
    STANDING,
    MeshShapes,
    batches,
    carriers,
    standing_body,
)
from pioneer_gazebo.physics.engine import Contact, EngineError, JointReading, Physics, Velocity
from pioneer_gazebo.physics.quiet_pybullet import pybullet
from pioneer_gazebo.world.model import PlacedCollision
from pioneer_gazebo.world.pose import Pose, Vector, added, opposite, rotated


def client_with_window() -> int:
    """Returns a pybullet physics client with a viewer.

    Raises:
        EngineError: the display does not respond. This is checked first, as pybullet would end the whole process.
    """
    name = os.environ.get("DISPLAY", "")
    if not display_answers(name):
        raise EngineError(f"gui: a window needs a display, and none answers at DISPLAY={name!r}")
    client = pybullet.connect(pybullet.GUI)
    if client < 0:
        raise EngineError(
            f"gui: pybullet cannot open its window at {name}; does the display support OpenGL 3?"
        )
    for option in (pybullet.COV_ENABLE_GUI, pybullet.COV_ENABLE_KEYBOARD_SHORTCUTS):
        pybullet.configureDebugVisualizer(option, 0, physicsClientId=client)
    pybullet.resetDebugVisualizerCamera(12.0, 0.0, -60.0, (0.0, 0.0, 0.0), physicsClientId=client)
    return client


def display_answers(name: str) -> bool:
    """Returns whether an X server listens at ``name`` (``:0``, ``host:10.0``)."""
    host, colon, rest = name.rpartition(":")
    number = rest.partition(".")[0]
    if not (colon and number.isdigit()):
        return False
    try:
        if host in ("", "unix"):
            with socket.socket(socket.AF_UNIX) as local:
                local.connect(f"/tmp/.X11-unix/X{number}")
        else:
            socket.create_connection((host, 6000 + int(number)), timeout=2.0).close()
    except OSError:
        return False
    return True


_BOTH_WANT = 0
"""Filter mode: bodies collide if each one's mask contains the other's group; by default pybullet needs only one."""

CARRYING = 0.7
"""A contact supports a body if the z component of its normal exceeds this."""

NEAR = 0.05
"""A sleeping body wakes if something within this distance [m] of it is moved or removed."""

BEYOND = 5e-4
"""How far a joint may pass a limit [rad or m]."""

_NOWHERE = (0.0, 0.0, 0.0)

FARTHEST = 1e3
"""Depth below the origin at which support ray casts end [m]."""


_Push = tuple[int, int, Vector, Vector, Vector]
"""Handle of a body, link, force [N], torque [N m], and where the force acts [m]."""


def _without(handle: int, pushes: Sequence[_Push]) -> list[_Push]:
    """Returns the pushes of all other bodies."""
    return [push for push in pushes if push[0] != handle]


class BulletEngine:
    """Implements `Engine` with pybullet."""

    def __init__(self, physics: Physics | None = None, window: bool = False) -> None:
        """Opens a physics server in this process; ``window`` shows pybullet's viewer.

        Raises:
            EngineError: there is no display for the window.
        """
        self._client = client_with_window() if window else pybullet.connect(pybullet.DIRECT)
        self._meshes = MeshShapes(self._client)
        self._made: dict[int, Made] = {}
        self._resting: set[int] = set()
        #: since the last step: velocities that were set, and pushes, of bodies that may have slept
        self._given: dict[int, Velocity] = {}
        self._pushes: list[_Push] = []  # of resting bodies, for the next step
        self._missed: list[_Push] = []  # those that their bodies slept through in the last step
        self._ground: list[int] = []
        self._obstacles: list[int] = []
        self._ground_set: frozenset[int] = frozenset()
        self._fall: Vector = (0.0, 0.0, 0.0)  # velocity that gravity adds in a step
        self.configure(physics or Physics())

    def configure(self, physics: Physics) -> None:
        x, y, z = (part * physics.step for part in physics.gravity)
        if (x, y, z) != self._fall:
            self._wake_all()
        self._fall, self._step = (x, y, z), physics.step
        pybullet.setGravity(*physics.gravity, physicsClientId=self._client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=physics.step,
            numSolverIterations=physics.iterations,
            numSubSteps=1,
            deterministicOverlappingPairs=1,
            # The friction pyramid costs a fifth less than the cone and, at equal iterations, a tenth of the error of a
            # spin: the cone's direction is recomputed in every iteration and has not settled by the last.
            enableConeFriction=0,
            collisionFilterMode=_BOTH_WANT,
            physicsClientId=self._client,
        )

    def set_standing(
        self, ground: Sequence[PlacedCollision], obstacles: Sequence[PlacedCollision]
    ) -> None:
        made: list[int] = []
        try:
            made += [standing_body(batch, self._meshes) for batch in batches(ground)]
            count = len(made)
            made += [standing_body(batch, self._meshes) for batch in batches(obstacles)]
            made += carriers(obstacles, self._meshes)
        except EngineError:
            self._remove(made)
            raise
        self._remove(self._ground + self._obstacles)
        self._wake_all()
        self._ground, self._obstacles = made[:count], made[count:]
        for body in self._ground:
            pybullet.setCollisionFilterGroupMask(
                body, -1, GROUND, ALL, physicsClientId=self._client
            )
        self._ground_set = frozenset(self._ground)

    def _remove(self, bodies: Sequence[int]) -> None:
        for body in bodies:
            pybullet.removeBody(body, physicsClientId=self._client)

    def add(self, body: Body, pose: Pose) -> int:
        handle, made = make_body(body, pose, self._client)
        self._made[handle] = made
        return handle

    def remove(self, handle: int) -> None:
        self._wake_neighbours(handle)
        del self._made[handle]
        self._resting.discard(handle)
        self._given.pop(handle, None)
        self._pushes = _without(handle, self._pushes)
        self._missed = _without(handle, self._missed)
        pybullet.removeBody(handle, physicsClientId=self._client)

    def step(self) -> None:
        for push in self._missed:
            self._apply(*push)
        self._missed = []
        pybullet.stepSimulation(physicsClientId=self._client)
        for handle, made in self._made.items():
            if made.bounded:
                self._bring_back(handle, made)
        if self._given or self._pushes:
            self._make_up()

    def _bring_back(self, handle: int, made: Made) -> None:
        """Brings joints that have passed a limit back to it.

        pybullet holds a joint from the step on in which it is beyond its limit, wherever it is by then. What is left
        beyond it keeps pybullet holding.
        """
        links = [link for link, _, _ in made.bounded]
        states = pybullet.getJointStates(handle, links, physicsClientId=self._client)
        for (link, lower, upper), (position, *_) in zip(made.bounded, states, strict=True):
            nearest = min(max(position, lower - BEYOND), upper + BEYOND)
            if nearest != position:
                pybullet.resetJointState(handle, link, nearest, 0.0, physicsClientId=self._client)

    def _make_up(self) -> None:
        """Moves bodies that slept through the step in spite of a velocity or a push.

        pybullet wakes a body at the end of the next step, and that step takes its velocity away. A body is moved by
        what it has missed of the step; a push acts in the next one.
        """
        given, self._given = self._given, {}
        pushes, self._pushes = self._pushes, []
        concerned = {*given, *(handle for handle, *_ in pushes)}
        slept = {handle for handle in concerned if self._slept(handle)}
        for handle in slept & given.keys():
            self._move(handle, given[handle])
        self._missed = [push for push in pushes if push[0] in slept]

    def _slept(self, handle: int) -> bool:
        """Returns whether a body that is not fixed is without any motion after a step."""
        if pybullet.getDynamicsInfo(handle, -1, physicsClientId=self._client)[0] == 0.0:
            return False
        linear, angular = pybullet.getBaseVelocity(handle, physicsClientId=self._client)
        return not (any(linear) or any(angular))

    def _move(self, handle: int, velocity: Velocity) -> None:
        """Moves a body by one step; it also falls, unless it touches something."""
        client, linear = self._client, velocity.linear
        if not pybullet.getContactPoints(bodyA=handle, physicsClientId=client):
            linear = added(linear, self._fall)
        position, rotation = pybullet.getBasePositionAndOrientation(handle, physicsClientId=client)
        rate = math.hypot(*velocity.angular)
        if rate > 0.0:
            turn = pybullet.getQuaternionFromAxisAngle(velocity.angular, rate * self._step)
            _, rotation = pybullet.multiplyTransforms(_NOWHERE, turn, _NOWHERE, rotation)
        position = tuple(a + b * self._step for a, b in zip(position, linear, strict=True))
        pybullet.resetBasePositionAndOrientation(handle, position, rotation, physicsClientId=client)
        pybullet.resetBaseVelocity(handle, linear, velocity.angular, physicsClientId=client)

    def pose(self, handle: int, part: int = 0) -> Pose:
        if part:
            state = pybullet.getLinkState(
                handle, self._made[handle].links[part], 0, 1, physicsClientId=self._client
            )
            return Pose(state[4], state[5])
        position, rotation = pybullet.getBasePositionAndOrientation(
            handle, physicsClientId=self._client
        )
        return Pose(position, rotation).compose(self._made[handle].centres[0])

    def velocity(self, handle: int, part: int = 0) -> Velocity:
        if part:
            state = pybullet.getLinkState(
                handle, self._made[handle].links[part], 1, 1, physicsClientId=self._client
            )
            rotation, linear, angular = state[1], state[6], state[7]
        else:
            _, rotation = pybullet.getBasePositionAndOrientation(
                handle, physicsClientId=self._client
            )
            linear, angular = pybullet.getBaseVelocity(handle, physicsClientId=self._client)
        return Velocity(linear, angular).at(
            rotated(rotation, self._made[handle].centres[part].position)
        )

    def centre_velocity(self, handle: int) -> Velocity:
        return Velocity(*pybullet.getBaseVelocity(handle, physicsClientId=self._client))

    def set_pose(self, handle: int, pose: Pose) -> None:
        self._wake(handle)
        velocity = pybullet.getBaseVelocity(handle, physicsClientId=self._client)
        centre = pose.compose(self._made[handle].body.parts[0].inertia.pose)
        self._wake_neighbours(handle)
        pybullet.resetBasePositionAndOrientation(
            handle, centre.position, centre.rotation, physicsClientId=self._client
        )
        pybullet.resetBaseVelocity(handle, *velocity, physicsClientId=self._client)

    def set_velocity(self, handle: int, velocity: Velocity) -> None:
        self._wake(handle)
        _, rotation = pybullet.getBasePositionAndOrientation(handle, physicsClientId=self._client)
        centre = velocity.at(opposite(rotated(rotation, self._made[handle].centres[0].position)))
        pybullet.resetBaseVelocity(
            handle, centre.linear, centre.angular, physicsClientId=self._client
        )
        # What it should have moved by is replaced.
        self._missed = _without(handle, self._missed)
        if handle in self._resting and (any(centre.linear) or any(centre.angular)):
            self._given[handle] = centre
        else:
            self._given.pop(handle, None)

    def lead(self, handle: int, pose: Pose, velocity: Velocity) -> None:
        """Subtracts in advance the velocity that gravity adds during the step."""
        x, y, z = (v - fall for v, fall in zip(velocity.linear, self._fall, strict=True))
        pybullet.resetBasePositionAndOrientation(
            handle, pose.position, pose.rotation, physicsClientId=self._client
        )
        pybullet.resetBaseVelocity(
            handle, (x, y, z), velocity.angular, physicsClientId=self._client
        )

    def joints(self, handle: int, parts: Sequence[int]) -> list[JointReading]:
        if not parts:
            return []
        states = pybullet.getJointStates(
            handle, self._links(handle, parts), physicsClientId=self._client
        )
        return [state[:2] for state in states]  # position and speed

    def efforts(self, handle: int, parts: Sequence[int]) -> list[float]:
        states = pybullet.getJointStates(
            handle, self._links(handle, parts), physicsClientId=self._client
        )
        return [state[3] for state in states]

    def _links(self, handle: int, parts: Sequence[int]) -> list[int]:
        links = self._made[handle].links
        return [links[part] for part in parts]

    def set_joint(self, handle: int, part: int, position: float) -> None:
        self._wake(handle)
        self._wake_neighbours(handle)
        pybullet.resetJointState(
            handle, self._made[handle].links[part], position, 0.0, physicsClientId=self._client
        )

    def turn(
        self, handle: int, parts: Sequence[int], speeds: Sequence[float], efforts: Sequence[float]
    ) -> None:
        pybullet.setJointMotorControlArray(
            handle, self._links(handle, parts), pybullet.VELOCITY_CONTROL, targetVelocities=speeds, forces=efforts,
            physicsClientId=self._client,
        )  # fmt: skip

    def rest(self, handle: int, allowed: bool) -> None:
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

    def _wake_all(self) -> None:
        for handle in self._resting:
            self._wake(handle)

    def _wake_neighbours(self, handle: int) -> None:
        """Wakes the bodies beside and on a body; pybullet wakes none of them if their support goes away.

        What leans on a woken body wakes with it, in the step in which that moves.
        """
        links = range(-1, pybullet.getNumJoints(handle, physicsClientId=self._client))
        boxes = [pybullet.getAABB(handle, link, physicsClientId=self._client) for link in links]
        low = [min(corner) - NEAR for corner in zip(*(box[0] for box in boxes), strict=True)]
        high = [max(corner) + NEAR for corner in zip(*(box[1] for box in boxes), strict=True)]
        found = pybullet.getOverlappingObjects(low, high, physicsClientId=self._client)
        for neighbour in sorted({body for body, _ in found or ()} - {handle}):
            self._wake(neighbour)

    def push(
        self, handle: int, part: int, force: Vector, torque: Vector, point: Vector | None
    ) -> None:
        self._wake(handle)
        link = self._made[handle].links[part]
        if point is None:
            point = self._centre_of_mass(handle, link)
        self._apply(handle, link, force, torque, point)
        if handle in self._resting:
            self._pushes.append((handle, link, force, torque, point))

    def _apply(self, handle: int, link: int, force: Vector, torque: Vector, point: Vector) -> None:
        """Applies force and torque to a link for the next step."""
        frame, client = pybullet.WORLD_FRAME, self._client
        pybullet.applyExternalForce(handle, link, force, point, frame, physicsClientId=client)
        pybullet.applyExternalTorque(handle, link, torque, frame, physicsClientId=client)

    def _centre_of_mass(self, handle: int, link: int) -> Vector:
        """Returns the position of a link's centre of mass in the world; link -1 is the base."""
        client = self._client
        if link < 0:
            position, _ = pybullet.getBasePositionAndOrientation(handle, physicsClientId=client)
        else:
            position = pybullet.getLinkState(handle, link, physicsClientId=client)[0]
        x, y, z = position
        return x, y, z

    def contacts(self, handle: int) -> list[Contact]:
        points = pybullet.getContactPoints(bodyA=handle, physicsClientId=self._client)
        return [self._contact(point) for point in points if not self._carries(point)]

    def _carries(self, point: tuple[Any, ...]) -> bool:
        """Returns whether a contact point is with the ground, or with a static body below that supports the body."""
        return point[2] in self._ground_set or (
            point[7][2] > CARRYING and point[2] not in self._made
        )

    def _contact(self, point: tuple[Any, ...]) -> Contact:
        other = point[2] if point[2] in self._made else None
        part = self._made[other].hosts[point[4] + 1] if other is not None else 0
        return Contact(
            self._made[point[1]].hosts[point[3] + 1],
            other,
            part,
            point[6],
            point[7],
            -point[8],
            point[9],
        )

    def touching(self) -> set[int]:
        """Queries by link: wheels touch only the ground, and each contact point costs 6 µs to read."""
        return {
            handle
            for handle, made in self._made.items()
            if any(self._is_touched(handle, one) for one in made.solid)
        }

    def _is_touched(self, handle: int, link: int) -> bool:
        points = pybullet.getContactPoints(
            bodyA=handle, linkIndexA=link, physicsClientId=self._client
        )
        return any(point[9] > 0.0 and not self._carries(point) for point in points)

    def support(self, points: Sequence[tuple[float, float]], top: float) -> float | None:
        hits = pybullet.rayTestBatch(
            [(x, y, top) for x, y in points], [(x, y, -FARTHEST) for x, y in points],
            collisionFilterMask=STANDING | GROUND, physicsClientId=self._client,
        )  # fmt: skip
        # A ray that starts inside a shape hits it at once (fraction 0); that surface is not below.
        return max((hit[3][2] for hit in hits if hit[0] >= 0 and hit[2] > 0.0), default=None)

    def overlap(self, handle: int) -> list[Contact]:
        pybullet.performCollisionDetection(physicsClientId=self._client)
        points = pybullet.getContactPoints(bodyA=handle, physicsClientId=self._client)
        return [
            self._contact(one) for one in points if one[8] < 0.0 and one[2] not in self._ground_set
        ]

    def close(self) -> None:
        pybullet.disconnect(self._client)
