"""An engine without physics, for tests of the code above an engine: wheels never slip and nothing ever touches.

A body with two turned parts moves as if they were its wheels; any other body keeps its velocity. Calls are recorded.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from pioneer_gazebo.body.body import Body
from pioneer_gazebo.physics.engine import (
    STILL,
    Contact,
    EngineError,
    JointReading,
    Physics,
    Velocity,
)
from pioneer_gazebo.world.model import PlacedCollision
from pioneer_gazebo.world.pose import Pose, Vector, rotated


@dataclass(slots=True)
class _FakeBody:
    body: Body
    pose: Pose
    velocity: Velocity = STILL
    speeds: dict[int, float] = field(default_factory=dict)
    angles: dict[int, float] = field(default_factory=dict)


class FakeEngine:
    """An engine without physics: bodies move as commanded, on a plane."""

    def __init__(self, track: float = 0.33, radius: float = 0.0975) -> None:
        #: track: distance between a body's wheels [m]
        #: radius: radius of its wheels [m]
        self.track, self.radius = track, radius
        self.steps = 0  #: steps so far
        self.touched: set[int] = set()  #: handles that `touching` reports; set by the test
        self.resting: set[int] = set()  #: handles that may sleep
        self.pushed: list[
            tuple[int, int, Vector, Vector, Vector]
        ] = []  #: arguments of every `push`
        #: arguments of the last `set_standing`: ground, obstacles
        self.standing: tuple[list[PlacedCollision], list[PlacedCollision]] = ([], [])
        self.refuses = ""  #: a body of this name is refused
        self._bodies: dict[int, _FakeBody] = {}
        self._physics = Physics()
        self._last = 0

    def configure(self, physics: Physics) -> None:
        self._physics = physics

    def set_standing(
        self, ground: Sequence[PlacedCollision], obstacles: Sequence[PlacedCollision]
    ) -> None:
        self.standing = list(ground), list(obstacles)

    def add(self, body: Body, pose: Pose) -> int:
        if body.name == self.refuses:
            raise EngineError(f"the physics engine refuses body {body.name}")
        self._last += 1
        self._bodies[self._last] = _FakeBody(body, pose)
        return self._last

    def remove(self, handle: int) -> None:
        del self._bodies[handle]

    def step(self) -> None:
        self.steps += 1
        for body in self._bodies.values():
            self._roll(body)

    def _roll(self, body: _FakeBody) -> None:
        step = self._physics.step
        for part, speed in body.speeds.items():
            body.angles[part] = body.angles.get(part, 0.0) + speed * step
        if len(body.speeds) == 2:
            left, right = (speed * self.radius for speed in body.speeds.values())
            speed, turn, yaw = (left + right) / 2, (right - left) / self.track, body.pose.yaw
            body.velocity = Velocity(
                (speed * math.cos(yaw), speed * math.sin(yaw), 0.0), (0.0, 0.0, turn)
            )
        (x, y, z), (vx, vy, vz) = body.pose.position, body.velocity.linear
        yaw = body.pose.yaw + body.velocity.angular[2] * step
        body.pose = Pose.from_rpy(x + vx * step, y + vy * step, z + vz * step, yaw=yaw)

    def pose(self, handle: int, part: int = 0) -> Pose:
        """Returns a part's pose as described; joint positions have no effect."""
        body = self._bodies[handle]
        if part == 0:
            return body.pose
        joint = body.body.parts[part].joint
        assert joint is not None, "only a base has no joint"
        return self.pose(handle, body.body.parts[part].parent).compose(joint.pose)

    def velocity(self, handle: int, part: int = 0) -> Velocity:
        """Returns the base's velocity for every part."""
        del part
        return self._bodies[handle].velocity

    def centre_velocity(self, handle: int) -> Velocity:
        body = self._bodies[handle]
        centre = body.body.parts[0].inertia.pose.position
        return body.velocity.at(rotated(body.pose.rotation, centre))

    def set_pose(self, handle: int, pose: Pose) -> None:
        self._bodies[handle].pose = pose

    def set_velocity(self, handle: int, velocity: Velocity) -> None:
        self._bodies[handle].velocity = velocity

    def lead(self, handle: int, pose: Pose, velocity: Velocity) -> None:
        self._bodies[handle].pose, self._bodies[handle].velocity = pose, velocity

    def joints(self, handle: int, parts: Sequence[int]) -> list[JointReading]:
        body = self._bodies[handle]
        return [(body.angles.get(part, 0.0), body.speeds.get(part, 0.0)) for part in parts]

    def efforts(self, handle: int, parts: Sequence[int]) -> list[float]:
        """Returns zeros: nothing resists."""
        del handle
        return [0.0] * len(parts)

    def set_joint(self, handle: int, part: int, position: float) -> None:
        self._bodies[handle].angles[part] = position

    def turn(
        self, handle: int, parts: Sequence[int], speeds: Sequence[float], efforts: Sequence[float]
    ) -> None:
        del efforts
        self._bodies[handle].speeds.update(zip(parts, speeds, strict=True))

    def rest(self, handle: int, allowed: bool) -> None:
        (self.resting.add if allowed else self.resting.discard)(handle)

    def push(
        self, handle: int, part: int, force: Vector, torque: Vector, point: Vector | None
    ) -> None:
        self.pushed.append((handle, part, force, torque, point))

    def contacts(self, handle: int) -> list[Contact]:
        """Returns no contacts."""
        del handle
        return []

    def touching(self) -> set[int]:
        return self.touched & self._bodies.keys()

    def support(self, points: Sequence[tuple[float, float]], top: float) -> float | None:
        """Returns the height of the ground, which is at 0."""
        return 0.0 if points and top >= 0.0 else None

    def overlap(self, handle: int) -> list[Contact]:
        """Returns no overlaps."""
        del handle
        return []

    def close(self) -> None:
        self._bodies.clear()
