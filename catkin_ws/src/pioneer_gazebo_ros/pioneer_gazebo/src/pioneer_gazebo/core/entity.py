"""One thing that moves in the simulated world: a robot or a dynamic model."""

import math
from dataclasses import dataclass, field

from pioneer_gazebo.core.body import Body
from pioneer_gazebo.core.collision import CollisionCounter
from pioneer_gazebo.core.drive import Drive, Odometry
from pioneer_gazebo.core.engine import STILL, Velocity
from pioneer_gazebo.core.laser import Laser
from pioneer_gazebo.core.pose import IDENTITY, Pose, between
from pioneer_gazebo.core.robot import Robot
from pioneer_gazebo.core.script import Script


@dataclass(slots=True)
class Driven:
    """A drive together with what it turns: the parts of its left and right wheel, and how hard [N m]."""

    drive: Drive
    parts: tuple[int, int]
    torque: float
    before: Odometry = field(default_factory=Odometry)


@dataclass(frozen=True, slots=True)
class Mounted:
    """A laser together with where it sits: part of the body, and pose in that part."""

    laser: Laser
    part: int
    pose: Pose


@dataclass(slots=True, eq=False)
class Entity:
    """A body in the engine and what the simulator keeps of it.

    Attributes:
        name: of the model.
        namespace: of its topics, without slashes at the ends; empty for none.
        body: as the engine knows it.
        handle: the engine's number.
        initial: where it was spawned, and returns to on a reset.
        robot: what it was read from; None for a model without sensors and plugins.
        before: pose after the step before the last one.
        after: pose after the last step.
        number: its row among all that moves.
        at_rest: whether the engine may let it sleep.
        script: what moves it in place of physics; None for a body of its own.
        began: tick at which its script began.
        motion: velocity that the script gave it in the last step.
    """

    name: str
    namespace: str
    body: Body
    handle: int
    initial: Pose
    robot: Robot | None = None
    drives: list[Driven] = field(default_factory=list)
    lasers: list[Mounted] = field(default_factory=list)
    sonars: list[Mounted] = field(default_factory=list)
    before: Pose = IDENTITY
    after: Pose = IDENTITY
    collisions: CollisionCounter = field(default_factory=CollisionCounter)
    number: int = 0
    at_rest: bool = False
    script: Script | None = None
    began: int = 0
    motion: Velocity = STILL

    def at(self, part: float) -> Pose:
        """Returns the pose of the base's frame at ``part`` (0 … 1) of the last step."""
        return self.after if part >= 1.0 else between(self.before, self.after, part)


def heading(pose: Pose) -> float:
    """Returns the yaw [rad] of a pose, quickly."""
    x, y, z, w = pose.rotation
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
