"""A moving entity of the simulated world: a robot or a dynamic model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from pioneer_gazebo.body.body import Body
from pioneer_gazebo.laser.laser import Laser, laser_of_sonar
from pioneer_gazebo.noise import Noise
from pioneer_gazebo.physics.engine import STILL, Engine, JointReading, Velocity
from pioneer_gazebo.simulation.command import CommandQueue, Moment
from pioneer_gazebo.simulation.drive import Drive, Odometry, check_motion
from pioneer_gazebo.simulation.joint_motor import Follower, JointMotors
from pioneer_gazebo.simulation.noise_profile import DESCRIBED, NoiseProfile
from pioneer_gazebo.world.model import Script
from pioneer_gazebo.world.pose import IDENTITY, Pose, Quaternion, Vector, heading, rotated, scaled
from pioneer_gazebo.world.robot import (
    BaseDriver,
    Device,
    DiffDrive,
    Gps,
    GroundTruth,
    Imu,
    JointControl,
    JointStatePublisher,
    LaserSensor,
    LinkSensor,
    MimicJoint,
    PlanarMove,
    Robot,
    SonarSensor,
)

GAP = 0.5
"""A new episode begins after this simulated time [s] without contact."""


class CollisionCounter:
    """Counts the contact episodes of one body."""

    def __init__(self) -> None:
        self.count = 0
        self._last: float | None = None

    def touched(self, time: float) -> bool:
        """Records a contact at ``time`` [s]; returns whether it began a new episode."""
        new = self._last is None or time - self._last >= GAP
        self._last = time
        self.count += new
        return new


@dataclass(slots=True)
class Driven:
    """A drive and the wheels it turns."""

    drive: Drive  #: wheel speeds and odometry
    parts: tuple[int, ...]  #: parts of the left wheels, then of as many right wheels
    torque: float  #: maximum torque per wheel [N m]
    handle: int  #: of the body in the engine
    before: Odometry = field(default_factory=Odometry)  #: odometry before the last step
    #: pending commands: speed [m/s], turn [rad/s]
    commands: CommandQueue[tuple[float, float]] = field(default_factory=CommandQueue)

    def command(self, moment: Moment, speed: float, turn: float) -> None:
        """Queues a motion [m/s, rad/s] that arrived at ``moment``, for the first step that begins then or later.

        Thread-safe.

        Raises:
            CommandError: a value is not finite or too large; the previous command remains in force.
        """
        check_motion(speed, turn)
        self.commands.put(moment, (speed, turn))

    def obey(self, now: Moment) -> None:
        """Passes the commands that arrived by ``now`` to the drive."""
        for speed, turn in self.commands.take(now):
            self.drive.command(speed, turn)

    def moved_joint(self, part: int, joints: Sequence[JointReading]) -> None:
        """Takes note that the joint of a part was set to a position, which is no motion of its wheel."""
        if part in self.parts:
            self.drive.set_angles(*self.angles(joints))

    def turn(self, engine: Engine, speeds: tuple[float, float]) -> None:
        """Sets the speeds of the left and the right wheels [rad/s]."""
        side = len(self.parts) // 2
        each = (speeds[0],) * side + (speeds[1],) * side
        engine.turn(self.handle, self.parts, each, (self.torque,) * len(self.parts))

    def angles(self, joints: Sequence[JointReading]) -> tuple[float, float]:
        """Returns the mean rotation of the left and of the right wheels [rad].

        Args:
            joints: the joint of each part of the body but the base.
        """
        turned = [joints[part - 1][0] for part in self.parts]
        if len(turned) == 2:
            return turned[0], turned[1]
        side = len(turned) // 2
        return sum(turned[:side]) / side, sum(turned[side:]) / side

    def reset(self) -> None:
        """Stops the wheels, clears pending commands, and resets the odometry to the origin."""
        self.commands.clear()
        self.drive.reset()
        self.before = Odometry()


@dataclass(frozen=True, slots=True)
class Mounted:
    """A ray sensor mounted on a robot."""

    device: LaserSensor | SonarSensor  #: the sensor's configuration
    laser: Laser  #: casts the beams
    part: int  #: index of the body's part that carries it
    pose: Pose  #: pose in that part

    @property
    def upright(self) -> float:
        """The z component of its axis in that part's frame."""
        _, _, z = rotated(self.pose.rotation, (0.0, 0.0, 1.0))
        return z


@dataclass(slots=True)
class Mover:
    """Moves a base in the plane, in any direction."""

    config: PlanarMove  #: topics and frames
    #: pending commands: velocity ahead and to the left [m/s], turn rate [rad/s]
    commands: CommandQueue[tuple[float, float, float]] = field(default_factory=CommandQueue)
    wanted: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: the command in force
    motion: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: what limits allow of it
    silence: float = 0.0  #: since the last command [s]

    def command(self, moment: Moment, ahead: float, left: float, turn: float) -> None:
        """Queues a motion that arrived at ``moment``; thread-safe. Raises CommandError."""
        check_motion(math.hypot(ahead, left), turn)
        self.commands.put(moment, (ahead, left, turn))

    def obey(self, now: Moment, step: float, rotation: Quaternion, fall: float) -> Velocity | None:
        """Returns the world velocity for the ``step`` [s] that begins ``now``; None to stand still.

        Args:
            now: the time at which the step begins.
            step: its duration [s].
            rotation: of the base.
            fall: its vertical velocity [m/s], which is kept.
        """
        self.silence += step
        for motion in self.commands.take(now):
            self.wanted = motion
            self.silence = 0.0
        if self.config.commandTimeout and self.silence > self.config.commandTimeout:
            self.wanted = (0.0, 0.0, 0.0)
        if self.motion != self.wanted:
            config = self.config
            limits = (config.aheadLimits, config.leftLimits, config.turnLimits)
            ahead, left, turn = (
                limit.towards(speed, wanted, step)
                for limit, speed, wanted in zip(limits, self.motion, self.wanted, strict=True)
            )
            self.motion = ahead, left, turn
        if self.motion == (0.0, 0.0, 0.0):
            return None
        ahead, left, turn = self.motion
        yaw = heading(rotation)
        c, s = math.cos(yaw), math.sin(yaw)
        return Velocity((c * ahead - s * left, s * ahead + c * left, fall), (0.0, 0.0, turn))

    def reset(self) -> None:
        """Clears all commands."""
        self.commands.clear()
        self.wanted = self.motion = (0.0, 0.0, 0.0)
        self.silence = 0.0


@dataclass(frozen=True, slots=True)
class Earlier:
    """What the engine reported about a body before a step."""

    tick: int  #: at which the step began
    velocity: Velocity  #: of the base's centre of mass
    joints: Sequence[JointReading]  #: the joint of each part but the base

    def rate(self, part: int) -> float:
        """Returns the speed of the joint that moves a part [rad/s or m/s]."""
        _, rate = self.joints[part - 1]
        return rate


_NEED_MOTION = (Imu, Gps, GroundTruth, PlanarMove, JointStatePublisher, BaseDriver)


def needs_motion(robot: Robot) -> bool:
    """Returns whether a device of the robot reads more than the pose of the base."""
    root = robot.root.name
    return any(
        isinstance(device, _NEED_MOTION)
        or (isinstance(device, LinkSensor) and device.link != root)
        or (
            isinstance(device, DiffDrive)
            and (
                device.publishWheelTF
                or device.publishWheelJointState
                or device.odometrySource == "world"
            )
        )
        for device in robot.devices
    )


@dataclass(slots=True, eq=False)
class Entity:
    """A body in the engine with the simulator's data about it."""

    name: str  #: name of the model
    namespace: str  #: namespace of its topics, without leading and trailing slashes; empty for none
    body: Body  #: the body passed to the engine
    handle: int  #: handle of the body in the engine
    initial: Pose  #: spawn pose, restored by a reset
    robot: Robot | None = (
        None  #: the robot's description; None for a model without sensors and plugins
    )
    drives: list[Driven] = field(default_factory=list)
    movers: list[Mover] = field(default_factory=list)
    motors: list[JointMotors] = field(default_factory=list)  #: of its ros_control controllers
    followers: list[Follower] = field(default_factory=list)  #: joints that follow others
    lasers: list[Mounted] = field(default_factory=list)
    sonars: list[Mounted] = field(default_factory=list)
    before: Pose = (
        IDENTITY  #: pose before the last step; kept only if poses between steps are needed
    )
    after: Pose = IDENTITY  #: pose at tick `seen`
    seen: int = 0  #: tick at which `after` was read
    joints: Sequence[JointReading] = ()  #: at tick `joints_seen`: of each part but the base
    joints_seen: int = -1  #: tick at which `joints` were read; -1 if they must be read again
    earlier: Earlier | None = None  #: velocities before the last step, if a device may need them
    needs_motion: bool = False  #: whether its devices read velocities, joints or other links
    needs_acceleration: bool = False  #: whether it has an inertial unit
    collisions: CollisionCounter = field(default_factory=CollisionCounter)
    number: int = 0  #: row in the array of moving entities
    at_rest: bool = False  #: whether the engine may put it to sleep
    script: Script | None = (
        None  #: script that moves it instead of physics; None for ordinary bodies
    )
    began: int = 0  #: tick at which its script began
    motion: Velocity = STILL  #: velocity given by its script in the last step
    is_weightless: bool = field(init=False)  #: whether gravity does not act on some of its parts
    #: outline of its base for lasers; parts that move relative to the base are `Swinging`
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
        """Sets the outline: lasers see robots with all joints at 0, but of other models only the base."""
        self.is_weightless = any(part.weightless is not None for part in self.body.parts)
        self.outline = (
            self.body if self.robot is not None else Body(self.body.name, self.body.parts[:1])
        )


@dataclass(frozen=True, slots=True)
class Swinging:
    """A jointed part of a world's model, with the outline that lasers see, in the part's frame."""

    entity: Entity
    part: int
    outline: Body


def swinging_parts(entity: Entity) -> list[Swinging]:
    """Returns the parts of an entity that lasers see separately from its base; none for a robot."""
    if entity.robot is not None:
        return []
    return [
        Swinging(entity, number, Body(part.name, (replace(part, parent=-1, joint=None),)))
        for number, part in enumerate(entity.body.parts)
        if number and part.touches
    ]


def noise_of(entity: Entity, device: Device, seed: int) -> Noise:
    """Returns the noise of a device, which no other device has, whatever their names."""
    assert entity.robot is not None, "only a robot has devices"
    number = next(number for number, one in enumerate(entity.robot.devices) if one is device)
    return Noise(seed, entity.name, device.name, str(number))


def equip(
    entity: Entity, seed: int, error: float, scale: float, profile: NoiseProfile = DESCRIBED
) -> None:
    """Adds the drives and ray sensors of an entity's robot, if it is one.

    Args:
        entity: the entity.
        seed: of the sensors' noise and the errors in the wheel diameters assumed by odometry.
        error: standard deviation of these errors, relative to the diameter.
        scale: mean ratio of assumed to true diameter.
        profile: least noise of drives and lasers.
    """
    if (robot := entity.robot) is None:
        return
    body = entity.body
    frames = body.frames()

    def driven(config: DiffDrive) -> Driven:
        errors = noise_of(entity, config, seed).at(0).standard_normal(2) * max(
            error, profile.wheel_diameter
        )
        drive = Drive(config, *(scale * (1.0 + float(error)) for error in errors))
        left, right = (tuple(body.joint_index(joint) for joint in side) for side in config.joints())
        is_left_right = frames[left[0]].position[1] < frames[right[0]].position[1]
        is_swapped = config.legacyMode == "true" or (not config.legacyMode and is_left_right)
        return Driven(
            drive, right + left if is_swapped else left + right, config.wheelTorque, entity.handle
        )

    def mounted(device: LaserSensor | SonarSensor) -> Mounted:
        part, at = body.part_of(device.link)
        if isinstance(device, SonarSensor):
            config = laser_of_sonar(device)
        else:
            config = profile.applied(device, Noise(seed, entity.name, device.name, "bias"))
        laser = Laser(config, noise_of(entity, device, seed))
        return Mounted(device, laser, part, at.compose(device.pose))

    entity.needs_motion = needs_motion(robot)
    entity.needs_acceleration = bool(robot.of(Imu))
    entity.drives = [driven(config) for config in robot.drives]
    entity.movers = [Mover(config) for config in robot.of(PlanarMove)]
    entity.motors = [
        JointMotors(config, body, tuple(map(body.joint_index, config.jointName)), entity.handle)
        for config in robot.of(JointControl)
    ]
    entity.followers = [
        Follower(
            config,
            body,
            body.joint_index(config.mimicJoint),
            body.joint_index(config.joint),
            entity.handle,
        )
        for config in robot.of(MimicJoint)
    ]
    entity.lasers = [mounted(config) for config in robot.lasers]
    entity.sonars = [mounted(config) for config in robot.sonars]


def control(engine: Engine, entity: Entity, now: Moment, step: float) -> None:
    """Applies the commands that an entity received by ``now`` for the next ``step`` [s]."""
    for driven in entity.drives:
        driven.obey(now)
    speeds = [driven.drive.wheel_speeds(step) for driven in entity.drives]
    at_rest = all(driven.drive.at_rest for driven in entity.drives)
    if entity.movers:
        at_rest = _move(engine, entity, now, step) and at_rest
    for motor in entity.motors:
        motor.obey(now)
        at_rest = motor.turn(engine, step) and at_rest
    for follower in entity.followers:
        at_rest = follower.turn(engine, step) and at_rest
    if entity.is_weightless:
        at_rest = False
    if at_rest != entity.at_rest:
        entity.at_rest = at_rest
        engine.rest(entity.handle, at_rest)
    for driven, wanted in zip(entity.drives, speeds, strict=True):
        if wanted is not None:
            driven.turn(engine, wanted)


def carry(engine: Engine, entity: Entity, gravity: Vector) -> None:
    """Takes the weight of those parts of an entity on which gravity [m/s²] does not act, for the next step."""
    for number, part in enumerate(entity.body.parts):
        if part.weightless is not None:
            mass, centre = part.weightless
            at = engine.pose(entity.handle, number).transform(centre)
            engine.push(entity.handle, number, scaled(gravity, -mass), (0.0, 0.0, 0.0), at)


def _move(engine: Engine, entity: Entity, now: Moment, step: float) -> bool:
    """Moves a base in the plane; returns whether it is to stand still."""
    fall = engine.velocity(entity.handle).linear[2]
    rotation = engine.pose(entity.handle).rotation
    motions = [mover.obey(now, step, rotation, fall) for mover in entity.movers]
    motion = next((one for one in motions if one is not None), None)
    if motion is not None or not entity.at_rest:
        engine.set_velocity(entity.handle, motion or Velocity((0.0, 0.0, fall)))
    return motion is None
