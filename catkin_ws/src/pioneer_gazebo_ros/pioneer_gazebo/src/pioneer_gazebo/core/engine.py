"""What the simulator asks of a physics engine. Positions [m], angles [rad], SI throughout, all in the world frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from pioneer_gazebo.core.body import Body
from pioneer_gazebo.core.error import SimulatorError
from pioneer_gazebo.core.pose import Pose, Quaternion, Vector, added, conjugate, cross, rotated
from pioneer_gazebo.core.world import PlacedCollision


class EngineError(SimulatorError):
    """The engine cannot do what it was asked; the world is as it was before."""


@dataclass(frozen=True, slots=True)
class Velocity:
    """Velocity of a frame's origin [m/s] and turn rate [rad/s], in the world's axes."""

    linear: Vector = (0.0, 0.0, 0.0)
    angular: Vector = (0.0, 0.0, 0.0)

    def at(self, arm: Vector) -> "Velocity":
        """Returns the velocity of a point of the same rigid body, ``arm`` [m] in the world's axes from this one."""
        return Velocity(added(self.linear, cross(self.angular, arm)), self.angular)

    def seen_from(self, rotation: Quaternion) -> "Velocity":
        """Returns the same velocity in the axes of a frame that is turned by ``rotation`` in the world."""
        back = conjugate(rotation)
        return Velocity(rotated(back, self.linear), rotated(back, self.angular))


STILL = Velocity()


@dataclass(frozen=True, slots=True)
class Contact:
    """A point where a body touches something."""

    part: int  #: index of the body's part
    other: int | None  #: handle of the other body; None for the standing world
    other_part: int  #: index of the other body's part; 0 for the standing world
    position: Vector  #: on the other's surface [m]
    normal: Vector  #: unit vector from the other towards the body
    depth: float  #: penetration [m]; negative while the surfaces are apart
    force: float  #: along the normal [N]


@dataclass(frozen=True, slots=True)
class Physics:
    """Settings of the engine."""

    step: float = 0.02  #: [s] of one step
    iterations: int = 20  #: of the constraint solver
    gravity: Vector = (0.0, 0.0, -9.81)  #: [m/s²]


class Engine(Protocol):
    """A world of standing shapes and of bodies that move. Used from one thread."""

    def configure(self, physics: Physics) -> None:
        """Takes new settings from the next step on."""

    def set_standing(self, ground: Sequence[PlacedCollision], obstacles: Sequence[PlacedCollision]) -> None:
        """Replaces the standing world: what wheels roll on, and all the rest.

        Raises:
            EngineError: a shape cannot be made.
        """

    def add(self, body: Body, pose: Pose) -> int:
        """Adds a body with its base's frame at ``pose``, at rest, and returns its handle.

        Raises:
            EngineError: a shape cannot be made.
        """

    def remove(self, handle: int) -> None:
        """Removes a body."""

    def step(self) -> None:
        """Advances by one step."""

    def pose(self, handle: int, part: int = 0) -> Pose:
        """Returns the pose of a part's frame."""

    def velocity(self, handle: int, part: int = 0) -> Velocity:
        """Returns the velocity of a part's frame."""

    def set_pose(self, handle: int, pose: Pose) -> None:
        """Moves the base's frame, and the whole body with it; velocities stay."""

    def set_velocity(self, handle: int, velocity: Velocity) -> None:
        """Sets the velocity of the base's frame."""

    def lead(self, handle: int, pose: Pose, velocity: Velocity) -> None:
        """Has a body that is led stand at ``pose`` and move with ``velocity`` during the next step."""

    def joints(self, handle: int, parts: Sequence[int]) -> list[tuple[float, float]]:
        """Returns position and speed of the joints that move ``parts`` [rad or m, and a second]."""

    def efforts(self, handle: int, parts: Sequence[int]) -> list[float]:
        """Returns what the motors of the joints that move ``parts`` applied in the last step [N m or N]."""

    def set_joint(self, handle: int, part: int, position: float) -> None:
        """Puts a joint to a position, at rest."""

    def turn(self, handle: int, parts: Sequence[int], speeds: Sequence[float], efforts: Sequence[float]) -> None:
        """Has joints held at speeds [rad/s] from now on, by at most these efforts [N m]; does not wake a body."""

    def rest(self, handle: int, allowed: bool) -> None:
        """Lets a body fall asleep while it lies still, until something touches it, or keeps it awake.

        A body that sleeps costs nothing and does not creep.
        """

    def push(self, handle: int, part: int, force: Vector, torque: Vector, point: Vector) -> None:
        """Applies a force [N] at ``point`` and a torque [N m] during the next step."""

    def contacts(self, handle: int) -> list[Contact]:
        """Returns the body's contacts in the last step, but for those with what carries it."""

    def touching(self) -> set[int]:
        """Returns the handles of all bodies that touched anything in the last step but what carries them."""

    def support(self, points: Sequence[tuple[float, float]], top: float) -> float | None:
        """Returns the greatest height [m], at most ``top``, that anything standing has below these x, y [m]."""

    def overlap(self, handle: int) -> list[Contact]:
        """Returns where the body stands inside something other than the ground, without a step."""

    def close(self) -> None:
        """Frees the engine; nothing may be asked of it afterwards."""
