"""What a robot is made of: links and joints as in URDF, sensors and plugins as gazebo_ros names them.

Configuration classes carry the names of the ``<gazebo>`` elements they come from, so that a user of gazebo_ros
finds each setting again. Lengths [m], angles [rad], masses [kg], rates [Hz].
"""

# ruff: noqa: N815 - fields are named as the plugins' elements are

import math
from dataclasses import dataclass
from typing import TypeVar

from pioneer_gazebo.core.device import Gps, Imu, PlanarMove, RosControl
from pioneer_gazebo.core.joint import Joint
from pioneer_gazebo.core.pose import IDENTITY, Pose, Vector
from pioneer_gazebo.core.world import Link


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of a velocity and of its change, in m or rad a second; infinite for none."""

    least: float = -math.inf
    most: float = math.inf
    fall: float = -math.inf
    rise: float = math.inf

    def towards(self, now: float, wanted: float, step: float) -> float:
        """Returns the velocity after a ``step`` [s] in which ``now`` shall become ``wanted``."""
        wanted = min(max(wanted, self.least), self.most)
        return min(max(wanted, now + self.fall * step), now + self.rise * step)


NO_LIMITS = Limits()


@dataclass(frozen=True, slots=True)
class DiffDrive:
    """``libgazebo_ros_diff_drive.so``: drives two wheels by a Twist and publishes odometry.

    Attributes:
        leftJoint: wheel joint on the left, and so on; every other name is the plugin's element.
        wheelSeparation: between the wheels' contact points [m].
        wheelDiameter: [m].
        wheelAcceleration: largest change of a wheel's rim speed [m/s²]; 0 for no limit.
        wheelTorque: largest torque at a wheel [N m].
        commandTimeout: without a command for longer the wheels stop [s]; 0 for never (ours, not gazebo_ros').
        updateRate: of commands and odometry [Hz]; 0 for every step.
        odometrySource: ``encoder`` (integrates the wheels) or ``world`` (the true pose).
        legacyMode: ``true`` if the joint called left is on the right; empty: as the joints lie.
        leftRearJoint: further wheels on the left, as ``libgazebo_ros_skid_steer_drive.so`` has; so ``rightRearJoint``.
        speedLimits: of the commanded speed, as ``diff_drive_controller`` has; so ``turnLimits``.
    """

    name: str = "diff_drive"
    leftJoint: str = "left_joint"
    rightJoint: str = "right_joint"
    wheelSeparation: float = 0.34
    wheelDiameter: float = 0.15
    wheelAcceleration: float = 0.0
    wheelTorque: float = 5.0
    commandTimeout: float = 0.0
    updateRate: float = 100.0
    commandTopic: str = "cmd_vel"
    odometryTopic: str = "odom"
    odometryFrame: str = "odom"
    robotBaseFrame: str = "base_footprint"
    odometrySource: str = "world"
    publishTf: bool = True
    publishOdomTF: bool = True
    publishWheelTF: bool = False
    publishWheelJointState: bool = False
    legacyMode: str = ""
    leftRearJoint: tuple[str, ...] = ()
    rightRearJoint: tuple[str, ...] = ()
    speedLimits: Limits = NO_LIMITS
    turnLimits: Limits = NO_LIMITS

    def joints(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Returns the names of the joints that are called left and right."""
        return (self.leftJoint, *self.leftRearJoint), (self.rightJoint, *self.rightRearJoint)


@dataclass(frozen=True, slots=True)
class LinkSensor:
    """What all sensors of a link have.

    Attributes:
        name: the sensor's.
        link: the link that carries it.
        pose: of the sensor in that link; it looks along x, and its beams lie in the x-y plane.
        update_rate: measurements a second; 0 for every step.
        frame: ``frame_id``, before the prefix.
    """

    name: str
    link: str
    pose: Pose = IDENTITY
    update_rate: float = 10.0
    frame: str = ""


@dataclass(frozen=True, slots=True)
class LaserSensor(LinkSensor):
    """A planar laser: ``<sensor type="ray">`` with ``libgazebo_ros_laser.so`` (or the gpu one).

    Attributes:
        samples: beams a scan, the first at ``min_angle``, the last at ``max_angle``.
        min_range: nearest distance that is reported [m].
        max_range: farthest distance that is reported [m].
        resolution: step of a range [m]; 0 for none.
        noise_mean: of the gaussian noise [m].
        noise_stddev: of the gaussian noise [m].
        topic: relative to the robot's namespace.
    """

    samples: int = 180
    min_angle: float = -1.5707963267948966
    max_angle: float = 1.5707963267948966
    min_range: float = 0.1
    max_range: float = 30.0
    resolution: float = 0.0
    noise_mean: float = 0.0
    noise_stddev: float = 0.0
    topic: str = "base_scan"


@dataclass(frozen=True, slots=True)
class SonarSensor(LinkSensor):
    """A range finder with a cone about x: ``<sensor type="ray">`` with ``libgazebo_ros_range.so``.

    Attributes:
        samples: rays across the cone (horizontal) that find the nearest thing.
        fov: full opening angle [rad].
        min_range: [m].
        max_range: [m]; also what is published when nothing is met.
        radiation: ``ultrasound`` or ``infrared``.
        gaussianNoise: standard deviation [m].
        topic: relative to the robot's namespace.
    """

    samples: int = 5
    fov: float = 0.3490658503988659
    min_range: float = 0.1
    max_range: float = 5.0
    radiation: str = "ultrasound"
    gaussianNoise: float = 0.0
    topic: str = "sonar"


@dataclass(frozen=True, slots=True)
class Camera(LinkSensor):
    """``<sensor type="camera">`` with ``libgazebo_ros_camera.so``; its name, ``cameraName``, is its topics' namespace.

    Attributes:
        horizontal_fov: [rad].
        width: [pixel].
        height: [pixel].
        near: nearest depth that is drawn [m].
        far: farthest [m].
        format: SDF's name of the pixel format, ``R8G8B8`` or ``L8``.
        noise_stddev: gaussian, of a pixel's value in 0 … 1.
        image_topic: relative to ``name``; so the other topics.
        depth_topic: of the picture's distances [m]; empty for none.
        cloud_topic: of the same as points; empty for none.
    """

    horizontal_fov: float = 1.3962634
    width: int = 320
    height: int = 240
    near: float = 0.02
    far: float = 300.0
    format: str = "R8G8B8"
    noise_stddev: float = 0.0
    image_topic: str = "image_raw"
    info_topic: str = "camera_info"
    depth_topic: str = ""
    cloud_topic: str = ""


@dataclass(frozen=True, slots=True)
class GroundTruth:
    """``libgazebo_ros_p3d.so``: the true pose and velocity of one link.

    Attributes:
        bodyName: the link.
        topicName: relative to the robot's namespace.
        frameName: ``frame_id``: ``map`` and ``world`` both mean the world's origin.
        updateRate: [Hz]; 0 for every step.
        gaussianNoise: standard deviation of the velocities, as the plugin does it.
        xyzOffset: added to the position [m].
        rpyOffset: added to the rotation [rad].
    """

    name: str
    bodyName: str
    topicName: str = "base_pose_ground_truth"
    frameName: str = "map"
    updateRate: float = 10.0
    gaussianNoise: float = 0.0
    xyzOffset: Vector = (0.0, 0.0, 0.0)
    rpyOffset: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Bumper:
    """``<sensor type="contact">`` with ``libgazebo_ros_bumper.so``.

    Attributes:
        name: the sensor's.
        link: the link whose contacts are published.
        collision: SDF's name of the collision; empty for all of the link and of what is fixed to it,
            as Gazebo lumps them.
        bumperTopicName: relative to the robot's namespace.
        frameName: ``frame_id``: ``map`` and ``world`` both mean the world's origin.
        update_rate: [Hz].
    """

    name: str
    link: str
    collision: str = ""
    bumperTopicName: str = "bumper"
    frameName: str = "map"
    update_rate: float = 10.0


@dataclass(frozen=True, slots=True)
class JointStatePublisher:
    """``libgazebo_ros_joint_state_publisher.so``.

    Attributes:
        jointName: joints that are published, in this order; empty for every joint that moves.
        updateRate: [Hz]; 0 for every step.
        topicName: relative to the robot's namespace.
    """

    name: str = "joint_state_publisher"
    jointName: tuple[str, ...] = ()
    updateRate: float = 100.0
    topicName: str = "joint_states"


@dataclass(frozen=True, slots=True)
class BaseDriver:
    """``libpioneer_base_driver.so``, ours: what the maker's driver (rosaria) publishes about the robot's base.

    Attributes:
        updateRate: of the topics [Hz].
        frameName: ``frame_id`` of bumpers and sonar points, before the prefix.
        capacity: of the battery [A h].
        fullVoltage: of a full battery without load [V].
        emptyVoltage: of an empty one [V].
        resistance: inside the battery [Ω].
        initialCharge: 0 … 1.
        idlePower: what electronics and sensors draw [W].
        rollingResistance: force that rolling takes [N].
        driveEfficiency: of motors and gears, above 0, at most 1.
        windingLoss: what torque costs a motor [W/(N m)²].
    """

    name: str = "base_driver"
    updateRate: float = 2.0
    frameName: str = "base_link"
    capacity: float = 21.6
    fullVoltage: float = 12.9
    emptyVoltage: float = 11.4
    resistance: float = 0.05
    initialCharge: float = 1.0
    idlePower: float = 15.0
    rollingResistance: float = 3.0
    driveEfficiency: float = 0.5
    windingLoss: float = 3.0


Device = (
    DiffDrive
    | PlanarMove
    | RosControl
    | Imu
    | Gps
    | LaserSensor
    | SonarSensor
    | Camera
    | GroundTruth
    | Bumper
    | JointStatePublisher
    | BaseDriver
)
"""A sensor or plugin of a robot."""

Kind = TypeVar("Kind")


@dataclass(frozen=True, slots=True)
class Robot:
    """A whole robot.

    Attributes:
        name: as the file names it.
        links: in the file's order. A link's pose is that of its frame in the root link's frame, all joints at 0.
        joints: in the file's order; they make one tree over all links.
        devices: sensors and plugins, in the file's order.
        static: the model never moves (``<gazebo><static>``).
        warnings: one line for each kind of thing in the file that is not supported and was left out.
        namespace: that a plugin names for its topics; it counts where the robot is spawned without one.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...] = ()
    devices: tuple[Device, ...] = ()
    static: bool = False
    warnings: tuple[str, ...] = ()
    namespace: str = ""

    def of(self, kind: type[Kind]) -> tuple[Kind, ...]:
        """Returns the devices of one kind, in the file's order."""
        return tuple(device for device in self.devices if isinstance(device, kind))

    @property
    def drives(self) -> tuple[DiffDrive, ...]:
        """The drives that turn wheels."""
        return self.of(DiffDrive)

    @property
    def lasers(self) -> tuple[LaserSensor, ...]:
        """The planar lasers."""
        return self.of(LaserSensor)

    @property
    def sonars(self) -> tuple[SonarSensor, ...]:
        """The range finders."""
        return self.of(SonarSensor)

    @property
    def root(self) -> Link:
        """The one link that is no joint's child."""
        children = {joint.child for joint in self.joints}
        return next(link for link in self.links if link.name not in children)

    def link(self, name: str) -> Link:
        """Returns the link of that name.

        Raises:
            KeyError: there is none.
        """
        return {one.name: one for one in self.links}[name]
