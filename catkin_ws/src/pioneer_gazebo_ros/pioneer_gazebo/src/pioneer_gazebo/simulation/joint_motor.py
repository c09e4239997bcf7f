"""Motors of joints: they move joints to positions or at speeds, by efforts, or as another joint moves.

A motor sets the speed of a joint for each step. It carries any load up to its effort, so that a held joint does not
sag, as in Gazebo, whose position controllers set positions.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from pioneer_gazebo.body.body import Body
from pioneer_gazebo.physics.engine import Engine, JointReading
from pioneer_gazebo.simulation.command import CommandQueue, Moment
from pioneer_gazebo.simulation.drive import CommandError
from pioneer_gazebo.world import joint as kinds
from pioneer_gazebo.world.joint import Joint
from pioneer_gazebo.world.pose import opposite, rotated, scaled
from pioneer_gazebo.world.robot import EFFORT, POSITION, JointControl, MimicJoint

STRONGEST = 1e4
"""Effort of a motor that holds positions, and of one whose joint has no effort limit [N m or N]."""

APPROACH = 0.5
"""Part of its distance to the target that a joint moves in a step."""

FASTEST = 100.0
"""Maximum speed of a joint without a limit [rad/s or m/s]."""

GREATEST = 1e6
"""Greatest number in a command [rad, m, rad/s, m/s, N m or N]."""

REACHED = 1e-4
"""A joint this near its target [rad or m] is at rest."""

_NONE = (0.0, 0.0, 0.0)


def push_joint(engine: Engine, handle: int, body: Body, part: int, effort: float) -> None:
    """Applies an effort [N m or N] of the joint that moves ``part`` in the next step, and against its parent."""
    moved = body.parts[part]
    joint = moved.joint
    if joint is None:
        raise AssertionError(f"no joint moves {moved.name}")
    at = engine.pose(handle, part)
    along = scaled(rotated(at.rotation, joint.axis), effort)
    for pushed, push in ((part, along), (moved.parent, opposite(along))):
        if joint.kind == kinds.PRISMATIC:
            engine.push(handle, pushed, push, _NONE, at.position)
        else:
            engine.push(handle, pushed, _NONE, push, None)


def _joint(body: Body, part: int) -> Joint:
    joint = body.parts[part].joint
    if joint is None:
        raise AssertionError(f"no joint moves part {part} of {body.name}")
    return joint


def _bounded(joint: Joint, speed: float) -> float:
    """Returns a speed within a joint's limit [rad/s or m/s]; as in Gazebo, a limit of 0 is none."""
    most = joint.velocity if 0 < joint.velocity < FASTEST else FASTEST
    return min(max(speed, -most), most)


def _way(joint: Joint, target: float, position: float) -> float:
    """Returns how far a joint has to move to a target, which its limits bound [rad or m]."""
    return min(max(target, joint.lower), joint.upper) - position


@dataclass(slots=True)
class JointMotors:
    """The joints of one controller."""

    config: JointControl
    body: Body
    parts: tuple[int, ...]  #: that the joints move
    handle: int  #: of the body in the engine
    #: pending commands, a number for each joint
    commands: CommandQueue[tuple[float, ...]] = field(default_factory=CommandQueue)
    targets: tuple[float, ...] = ()  #: a number for each joint; empty before the first command

    def command(self, moment: Moment, values: Sequence[float]) -> None:
        """Queues a command that arrived at ``moment``; thread-safe.

        Raises:
            CommandError: there is not one number for each joint, or a number is not finite or too large.
        """
        if len(values) != len(self.parts):
            raise CommandError(
                f"{self.config.name}: a command needs {len(self.parts)} numbers (got {len(values)})"
            )
        if not all(abs(value) <= GREATEST for value in values):
            raise CommandError(
                f"{self.config.name}: a command must be finite and at most {GREATEST:g} (got {list(values)})"
            )
        self.commands.put(moment, tuple(values))

    def obey(self, now: Moment) -> None:
        """Takes the commands that arrived by ``now``."""
        for values in self.commands.take(now):
            self.targets = values

    def reset(self) -> None:
        """Clears all commands; joints are held where they are then."""
        self.commands.clear()
        self.targets = ()

    def turn(self, engine: Engine, step: float) -> bool:
        """Moves the joints for the next ``step`` [s]; returns whether they are to stand still."""
        targets = self.targets or (0.0,) * len(self.parts)
        if self.config.kind == EFFORT:
            for part, effort in zip(self.parts, targets, strict=True):
                if effort:
                    push_joint(engine, self.handle, self.body, part, self._limited(part, effort))
            return not any(targets)
        if self.config.kind == POSITION:
            speeds = self._speeds_to(self.targets, engine, step)
            efforts = [STRONGEST] * len(self.parts)
        else:
            speeds = [
                _bounded(_joint(self.body, part), target)
                for part, target in zip(self.parts, targets, strict=True)
            ]
            efforts = [self._limited(part, STRONGEST) for part in self.parts]
        engine.turn(self.handle, self.parts, speeds, efforts)
        return all(abs(speed) * step < REACHED for speed in speeds)

    def _speeds_to(self, targets: Sequence[float], engine: Engine, step: float) -> list[float]:
        """Returns the speeds for the next ``step`` [s] towards target positions; without targets, joints stay."""
        if not targets:
            return [0.0] * len(self.parts)
        joints = [_joint(self.body, part) for part in self.parts]
        readings = engine.joints(self.handle, self.parts)
        return [
            _bounded(joint, APPROACH * _way(joint, target, position) / step)
            for joint, target, (position, _) in zip(joints, targets, readings, strict=True)
        ]

    def _limited(self, part: int, effort: float) -> float:
        """Returns an effort within its joint's limit; as wheels without a usable limit move, 0 is none."""
        most = _joint(self.body, part).effort
        most = most if 0 < most < STRONGEST else STRONGEST
        return min(max(effort, -most), most)


@dataclass(slots=True)
class Follower:
    """A joint that follows another one."""

    config: MimicJoint
    body: Body
    part: int  #: that follows
    followed: int  #: part that the other joint moves
    handle: int  #: of the body in the engine

    def turn(self, engine: Engine, step: float) -> bool:
        """Moves the joint for the next ``step`` [s]; returns whether it has arrived."""
        readings: list[JointReading] = engine.joints(self.handle, (self.part, self.followed))
        (position, _), (other, rate) = readings
        config, joint = self.config, _joint(self.body, self.part)
        ahead = other + rate * step
        target = config.multiplier * ahead + config.offset
        speed = _bounded(joint, _way(joint, target, position) / step)
        engine.turn(self.handle, (self.part,), (speed,), (STRONGEST,))
        return abs(speed) * step < REACHED
