"""Interface of the physics engine. SI units (positions [m], angles [rad]), all in the world frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from pioneer_gazebo.body.body import Body
from pioneer_gazebo.error import SimulatorError
from pioneer_gazebo.world.model import PlacedCollision
from pioneer_gazebo.world.pose import Pose, Quaternion, Vector, added, conjugate, cross, rotated


class EngineError(SimulatorError):
    """The engine cannot perform a request; the world is unchanged."""


@dataclass(frozen=True, slots=True)
class Velocity:
    """Linear velocity of a frame's origin [m/s] and angular velocity [rad/s], in the world's axes."""

    linear: Vector = (0.0, 0.0, 0.0)
    angular: Vector = (0.0, 0.0, 0.0)

    def at(self, arm: Vector) -> "Velocity":
        """Returns the velocity of another point of the same rigid body, offset by ``arm`` [m] in the world's axes."""
        return Velocity(added(self.linear, cross(self.angular, arm)), self.angular)

    def seen_from(self, rotation: Quaternion) -> "Velocity":
        """Returns the same velocity in the axes of a frame with orientation ``rotation`` in the world."""
        back = conjugate(rotation)
        return Velocity(rotated(back, self.linear), rotated(back, self.angular))


STILL = Velocity()


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact point of a body."""

    part: int  #: index of the body's part
    other: int | None  #: handle of the other body; None for the static world
    other_part: int  #: index of the other body's part; 0 for the static world
    position: Vector  #: on the other body's surface [m]
    normal: Vector  #: unit vector from the other towards the body
    depth: float  #: penetration [m]; negative while the surfaces are apart
    force: float  #: along the normal [N]


@dataclass(frozen=True, slots=True)
class Physics:
    """Settings of the physics engine."""

    step: float = 0.02  #: duration of a physics step [s]
    iterations: int = 20  #: iterations of the constraint solver
    gravity: Vector = (0.0, 0.0, -9.81)  #: [m/s²]


JointReading = tuple[float, float]
"""Position [rad or m] and speed [rad/s or m/s] of a joint."""


class Engine(Protocol):
    """A world of static shapes and moving bodies. Used from one thread."""

    def configure(self, physics: Physics) -> None:
        """Applies new settings from the next step on; another gravity wakes all sleeping bodies."""

    def set_standing(
        self, ground: Sequence[PlacedCollision], obstacles: Sequence[PlacedCollision]
    ) -> None:
        """Replaces the static world, and wakes all bodies: the ground that wheels roll on, and all obstacles.

        Raises:
            EngineError: a shape cannot be created.
        """

    def add(self, body: Body, pose: Pose) -> int:
        """Adds a body at rest with its base frame at ``pose``; returns its handle.

        Raises:
            EngineError: a shape cannot be created.
        """

    def remove(self, handle: int) -> None:
        """Removes a body, and wakes those beside it and on it."""

    def step(self) -> None:
        """Advances by one physics step."""

    def pose(self, handle: int, part: int = 0) -> Pose:
        """Returns the pose of a part's frame."""

    def velocity(self, handle: int, part: int = 0) -> Velocity:
        """Returns the velocity of a part's frame."""

    def centre_velocity(self, handle: int) -> Velocity:
        """Returns the velocity of the base's centre of mass, which costs less than that of its frame."""

    def set_pose(self, handle: int, pose: Pose) -> None:
        """Moves the base frame, and the whole body with it; velocities are kept. Wakes those beside it and on it."""

    def set_velocity(self, handle: int, velocity: Velocity) -> None:
        """Sets the velocity of the base frame."""

    def lead(self, handle: int, pose: Pose, velocity: Velocity) -> None:
        """Sets a scripted body's pose, and its velocity during the next step."""

    def joints(self, handle: int, parts: Sequence[int]) -> list[JointReading]:
        """Returns the states of the joints that move ``parts``."""

    def efforts(self, handle: int, parts: Sequence[int]) -> list[float]:
        """Returns the efforts applied in the last step by the motors of the joints that move ``parts`` [N m or N]."""

    def set_joint(self, handle: int, part: int, position: float) -> None:
        """Sets a joint's position, at rest."""

    def turn(
        self, handle: int, parts: Sequence[int], speeds: Sequence[float], efforts: Sequence[float]
    ) -> None:
        """Sets target speeds [rad/s] and maximum efforts [N m] of joints; does not wake a sleeping body."""

    def rest(self, handle: int, allowed: bool) -> None:
        """Allows a motionless body to sleep until something touches it, or keeps it awake.

        A sleeping body costs nothing and does not creep.
        """

    def push(
        self, handle: int, part: int, force: Vector, torque: Vector, point: Vector | None
    ) -> None:
        """Applies a force [N] and a torque [N m] during the next step.

        The force acts at ``point`` in the world or, for None, at the part's centre of mass.
        """

    def contacts(self, handle: int) -> list[Contact]:
        """Returns the body's contacts in the last step, except those that support it."""

    def touching(self) -> set[int]:
        """Returns the handles of all bodies that touched anything in the last step except their support."""

    def support(self, points: Sequence[tuple[float, float]], top: float) -> float | None:
        """Returns the height [m] of the highest static surface below these x, y [m], at most ``top``; None for none."""

    def overlap(self, handle: int) -> list[Contact]:
        """Returns where the body penetrates something other than the ground, without a physics step."""

    def close(self) -> None:
        """Frees the engine; it must not be used afterwards."""
