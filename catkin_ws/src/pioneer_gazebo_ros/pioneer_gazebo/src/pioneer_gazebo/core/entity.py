"""One thing that moves in the simulated world: a robot or a dynamic model."""

import math
from collections import deque
from dataclasses import dataclass, field, replace

from pioneer_gazebo.core.body import Body
from pioneer_gazebo.core.collision import CollisionCounter
from pioneer_gazebo.core.device import PlanarMove
from pioneer_gazebo.core.drive import Drive, Odometry, check_motion
from pioneer_gazebo.core.engine import STILL, Engine, Velocity
from pioneer_gazebo.core.laser import Laser, generator_for, laser_of_sonar
from pioneer_gazebo.core.pose import IDENTITY, Pose, Quaternion, heading
from pioneer_gazebo.core.robot import DiffDrive, LaserSensor, Robot, SonarSensor
from pioneer_gazebo.core.script import Script

COMMANDS_KEPT = 100


@dataclass(slots=True)
class Driven:
    """A drive together with what it turns."""

    drive: Drive  #: wheel speeds and odometry
    parts: tuple[int, ...]  #: of the left wheels, then of as many right ones
    torque: float  #: at each wheel [N m]
    handle: int = -1  #: of the body in the engine
    before: Odometry = field(default_factory=Odometry)  #: odometry after the step before the last one
    #: what is still to be obeyed: tick, speed [m/s], turn [rad/s]. The newest counts, so few are kept.
    commands: deque[tuple[int, float, float]] = field(default_factory=lambda: deque(maxlen=COMMANDS_KEPT))

    def command(self, tick: int, speed: float, turn: float) -> None:
        """Takes a motion [m/s, rad/s] that came at ``tick``, for the first step that begins then or later.

        Any thread may call this.

        Raises:
            CommandError: a value that is not finite; the previous command holds.
        """
        check_motion(speed, turn)
        self.commands.append((tick, speed, turn))

    def obey(self, tick: int) -> None:
        """Hands the drive what has come by ``tick``."""
        while self.commands and self.commands[0][0] <= tick:
            self.drive.command(*self.commands.popleft()[1:])

    def turn(self, engine: Engine, speeds: tuple[float, float]) -> None:
        """Turns the left and the right wheels at these speeds [rad/s]."""
        side = len(self.parts) // 2
        each = (speeds[0],) * side + (speeds[1],) * side
        engine.turn(self.handle, self.parts, each, (self.torque,) * len(self.parts))

    def angles(self, engine: Engine) -> tuple[float, float]:
        """Returns how far the left and the right wheels have turned [rad], on the average."""
        states = engine.joints(self.handle, self.parts)
        if len(states) == 2:
            return states[0][0], states[1][0]
        turned = [angle for angle, _ in states]
        side = len(turned) // 2
        return sum(turned[:side]) / side, sum(turned[side:]) / side

    def reset(self) -> None:
        """Stops the wheels, forgets commands, and puts the odometry back to the origin."""
        self.commands.clear()
        self.drive.reset()
        self.before = Odometry()


@dataclass(frozen=True, slots=True)
class Mounted:
    """A fan of beams on a robot."""

    device: LaserSensor | SonarSensor  #: the sensor it stands for
    laser: Laser  #: casts the beams
    part: int  #: of the body that carries it
    pose: Pose  #: in that part


def mounted_on(body: Body, name: str, device: LaserSensor | SonarSensor, seed: int) -> Mounted:
    """Returns a sensor's beams on the robot ``name``, with noise of their own."""
    part, at = body.part_of(device.link)
    config = laser_of_sonar(device) if isinstance(device, SonarSensor) else device
    return Mounted(device, Laser(config, generator_for(seed, name, config.name)), part, at.compose(device.pose))


def driven_on(body: Body, name: str, config: DiffDrive, seed: int, error: float, scale: float) -> Driven:
    """Returns a drive of the robot ``name``.

    Args:
        body: the robot's.
        name: the robot's.
        config: of the drive.
        seed: of what encoders believe of the wheels' diameters.
        error: standard deviation of that, as a part of the diameter.
        scale: mean of that, as a part of the true diameter.
    """
    errors = generator_for(seed, name, config.name, "odometry").standard_normal(2) * error
    drive = Drive(config, *(scale * (1.0 + float(error)) for error in errors))
    left, right = (tuple(body.joint_index(joint) for joint in side) for side in config.joints())
    is_swapped = config.legacyMode == "true" or (not config.legacyMode and _y(body, left[0]) < _y(body, right[0]))
    return Driven(drive, right + left if is_swapped else left + right, config.wheelTorque)


def _y(body: Body, number: int) -> float:
    """Returns how far to the left of the base a part lies [m], joints at 0."""
    part = body.parts[number]
    pose = IDENTITY
    while part.joint is not None:
        pose = part.joint.pose.compose(pose)
        part = body.parts[part.parent]
    return pose.position[1]


@dataclass(slots=True)
class Mover:
    """What moves a base in the plane, in any direction."""

    config: PlanarMove  #: names of topics and frames
    #: what is still to be obeyed: tick, velocity ahead and to the left [m/s], turn rate [rad/s]
    commands: deque[tuple[int, float, float, float]] = field(default_factory=lambda: deque(maxlen=COMMANDS_KEPT))
    motion: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: what is obeyed now

    def command(self, tick: int, ahead: float, left: float, turn: float) -> None:
        """Takes a motion that came at ``tick``; any thread may call this. Raises CommandError."""
        check_motion(math.hypot(ahead, left), turn)
        self.commands.append((tick, ahead, left, turn))

    def obey(self, tick: int, rotation: Quaternion, fall: float) -> Velocity | None:
        """Returns the velocity for the step that begins at ``tick``, in the world; None where it is to stand.

        Args:
            tick: the present.
            rotation: of the base.
            fall: its vertical velocity [m/s], which stays.
        """
        while self.commands and self.commands[0][0] <= tick:
            self.motion = self.commands.popleft()[1:]
        if self.motion == (0.0, 0.0, 0.0):
            return None
        ahead, left, turn = self.motion
        yaw = heading(rotation)
        c, s = math.cos(yaw), math.sin(yaw)
        return Velocity((c * ahead - s * left, s * ahead + c * left, fall), (0.0, 0.0, turn))

    def reset(self) -> None:
        """Forgets all commands."""
        self.commands.clear()
        self.motion = (0.0, 0.0, 0.0)


@dataclass(slots=True, eq=False)
class Entity:
    """A body in the engine and what the simulator keeps of it."""

    name: str  #: of the model
    namespace: str  #: of its topics, without slashes at the ends; empty for none
    body: Body  #: as the engine knows it
    handle: int  #: the engine's number
    initial: Pose  #: where it was spawned, and returns to on a reset
    robot: Robot | None = None  #: what it was read from; None for a model without sensors and plugins
    drives: list[Driven] = field(default_factory=list)
    movers: list[Mover] = field(default_factory=list)
    lasers: list[Mounted] = field(default_factory=list)
    sonars: list[Mounted] = field(default_factory=list)
    before: Pose = IDENTITY  #: pose before the last step; kept only where something between the two is asked for
    after: Pose = IDENTITY  #: pose after the step ``seen``
    seen: int = 0  #: tick that `after` was read at
    collisions: CollisionCounter = field(default_factory=CollisionCounter)
    number: int = 0  #: its row among all that moves
    at_rest: bool = False  #: whether the engine may let it sleep
    script: Script | None = None  #: what moves it in place of physics; None for a body of its own
    began: int = 0  #: tick at which its script began
    motion: Velocity = STILL  #: velocity that the script gave it in the last step
    #: what lasers see where its base is; the parts that swing apart from it are `Swinging`
    outline: Body = field(init=False)

    def touch_name(self, part: int) -> str:
        """Returns ``model::part::collision`` of a part's first shape."""
        touches = self.body.parts[part].touches
        return f"{self.name}::{self.body.parts[part].name}::{touches[0].collision.name if touches else ''}"

    def driven(self, config: DiffDrive) -> Driven:
        """Returns the drive with that configuration."""
        return next(one for one in self.drives if one.drive.config is config)

    def mounted(self, device: LaserSensor | SonarSensor) -> Mounted:
        """Returns the beams of a sensor."""
        return next(one for one in (*self.lasers, *self.sonars) if one.device is device)

    def __post_init__(self) -> None:
        """Robots look as if their joints stood at 0, models of a world do not."""
        self.outline = self.body if self.robot is not None else Body(self.body.name, self.body.parts[:1])


@dataclass(frozen=True, slots=True)
class Swinging:
    """A part of a world's model that a joint moves, with what lasers see of it in the part's frame."""

    entity: Entity
    part: int
    outline: Body


def swinging_parts(entity: Entity) -> list[Swinging]:
    """Returns the parts of an entity that lasers see apart from its base: a robot has none."""
    if entity.robot is not None:
        return []
    return [
        Swinging(entity, number, Body(part.name, (replace(part, parent=-1, joint=None),)))
        for number, part in enumerate(entity.body.parts)
        if number and part.touches
    ]


def equip(entity: Entity, robot: Robot, seed: int, error: float, scale: float) -> None:
    """Gives an entity the drives, lasers and sonars of ``robot``; seed, error and scale as for `driven_on`."""
    body, name = entity.body, entity.name
    entity.drives = [driven_on(body, name, config, seed, error, scale) for config in robot.drives]
    for driven in entity.drives:
        driven.handle = entity.handle
    entity.movers = [Mover(config) for config in robot.of(PlanarMove)]
    entity.lasers = [mounted_on(body, name, config, seed) for config in robot.lasers]
    entity.sonars = [mounted_on(body, name, config, seed) for config in robot.sonars]
