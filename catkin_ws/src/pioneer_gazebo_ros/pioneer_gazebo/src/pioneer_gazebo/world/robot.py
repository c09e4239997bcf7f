"""Robot descriptions: links and joints as in URDF, sensors and plugins as in gazebo_ros.

Configuration classes use the names of the ``<gazebo>`` elements they come from, as known to users of gazebo_ros.
Lengths [m], angles [rad], masses [kg], rates [Hz].
"""

# ruff: noqa: N815 - fields are named after the plugins' elements

import math
from dataclasses import dataclass
from typing import TypeVar

from pioneer_gazebo.world.joint import Joint
from pioneer_gazebo.world.model import Link
from pioneer_gazebo.world.pose import IDENTITY, Pose, Vector


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of a velocity and of its rate of change, in m or rad per second; infinite for none."""

    least: float = -math.inf
    most: float = math.inf
    fall: float = -math.inf
    rise: float = math.inf

    def towards(self, now: float, wanted: float, step: float) -> float:
        """Returns the velocity after ramping from ``now`` towards ``wanted`` for a ``step`` [s]."""
        wanted = min(max(wanted, self.least), self.most)
        return min(max(wanted, now + self.fall * step), now + self.rise * step)


NO_LIMITS = Limits()


@dataclass(frozen=True, slots=True)
class PlanarMove:
    """``libgazebo_ros_planar_move.so``: moves the base in the plane as commanded by a Twist, in any direction."""

    name: str = "planar_move"
    commandTopic: str = "cmd_vel"
    odometryTopic: str = "odom"
    odometryFrame: str = "odom"
    robotBaseFrame: str = "base_footprint"
    odometryRate: float = 20.0  #: [Hz]
    publishTf: bool = True  #: whether ``odometryFrame`` is published above ``robotBaseFrame``
    #: the base stops after this time without a command [s]; 0 for never
    commandTimeout: float = 0.0
    aheadLimits: Limits = NO_LIMITS  #: of the commanded speed ahead, as in a mecanum controller
    leftLimits: Limits = NO_LIMITS
    turnLimits: Limits = NO_LIMITS
    #: of its topics, without leading and trailing slashes (``robotNamespace``); None for the robot's
    namespace: str | None = None


@dataclass(frozen=True, slots=True)
class RosControl:
    """``libgazebo_ros_control.so``: replaced by the controllers in the robot's namespace when it is spawned."""

    name: str = "gazebo_ros_control"
    #: of its topics, without leading and trailing slashes (``robotNamespace``); None for the robot's
    namespace: str | None = None


@dataclass(frozen=True, slots=True)
class Imu:
    """``libgazebo_ros_imu.so``, ``libgazebo_ros_imu_sensor.so`` or ``libhector_gazebo_ros_imu.so``."""

    name: str
    bodyName: str  #: the link
    topicName: str = "imu"  #: relative to the robot's namespace
    frame: str = ""  #: ``frame_id``, without the tf prefix
    updateRate: float = 0.0  #: [Hz]; 0 for every step
    gaussianNoise: float = 0.0  #: standard deviation of rates [rad/s] and accelerations [m/s²]
    #: whether the orientation is relative to the one at the start
    initialOrientationAsReference: bool = False
    rpyOffset: Vector = (0.0, 0.0, 0.0)  #: rotation added to the reported orientation [rad]
    #: of its topics, without leading and trailing slashes (``robotNamespace``); None for the robot's
    namespace: str | None = None


@dataclass(frozen=True, slots=True)
class Gps:
    """``libhector_gazebo_ros_gps.so``: geodetic position and velocity."""

    name: str
    bodyName: str  #: the link
    topicName: str = "fix"
    velocityTopicName: str = "fix_velocity"
    frameId: str = "/world"  #: ``frame_id``, used unchanged
    referenceLatitude: float = 49.9  #: of the world's origin [deg], north
    referenceLongitude: float = 8.9  #: of the world's origin [deg], east
    referenceAltitude: float = 0.0  #: of the world's origin [m]
    referenceHeading: float = 0.0  #: heading of the world's x axis [deg], clockwise from north
    updateRate: float = 4.0  #: [Hz]; 0 for every step
    #: of its topics, without leading and trailing slashes (``robotNamespace``); None for the robot's
    namespace: str | None = None


Diagonal = tuple[float, float, float, float, float, float]
"""The six values on the diagonal of a covariance matrix."""

ODOMETRY_COVARIANCE: Diagonal = (1e-5, 1e-5, 1e12, 1e12, 1e12, 1e-3)
"""Covariance diagonal of the odometry of gazebo_ros' diff drive."""


@dataclass(frozen=True, slots=True)
class DiffDrive:
    """``libgazebo_ros_diff_drive.so``: drives two wheels as commanded by a Twist and publishes odometry."""

    name: str = "diff_drive"
    leftJoint: str = "left_joint"  #: left wheel joint; all fields except ``name`` are named after the plugin's elements
    rightJoint: str = "right_joint"
    wheelSeparation: float = 0.34  #: distance between the wheels' contact points [m]
    wheelDiameter: float = 0.15  #: [m]
    wheelAcceleration: float = (
        0.0  #: maximum rim acceleration of a wheel [m/s²]; 0 for the default limit
    )
    wheelTorque: float = 5.0  #: maximum torque per wheel [N m]
    #: the wheels stop after this time without a command [s]; 0 for never (ours, not gazebo_ros')
    commandTimeout: float = 0.0
    updateRate: float = 100.0  #: rate of commands and odometry [Hz]; 0 for every step
    commandTopic: str = "cmd_vel"
    odometryTopic: str = "odom"
    odometryFrame: str = "odom"
    robotBaseFrame: str = "base_footprint"
    odometrySource: str = (
        "world"  #: ``encoder`` (integrates the wheels) or ``world`` (the true pose)
    )
    publishTf: bool = True
    publishOdomTF: bool = True
    publishWheelTF: bool = False
    publishWheelJointState: bool = False
    legacyMode: str = (
        ""  #: ``true`` if the joint called left is on the right; empty: by the joints' positions
    )
    #: leftRearJoint, rightRearJoint: further wheels, as in ``libgazebo_ros_skid_steer_drive.so``
    leftRearJoint: tuple[str, ...] = ()
    rightRearJoint: tuple[str, ...] = ()
    speedLimits: Limits = NO_LIMITS  #: of the commanded speed, as in ``diff_drive_controller``; likewise ``turnLimits``
    turnLimits: Limits = NO_LIMITS
    #: diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw, in m² and rad²
    poseCovariance: Diagonal = ODOMETRY_COVARIANCE
    twistCovariance: Diagonal = ODOMETRY_COVARIANCE
    #: of its topics, without leading and trailing slashes (``robotNamespace``); None for the robot's
    namespace: str | None = None

    def joints(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Returns the names of the joints called left and of those called right."""
        return (self.leftJoint, *self.leftRearJoint), (self.rightJoint, *self.rightRearJoint)


@dataclass(frozen=True, slots=True)
class LinkSensor:
    """Settings common to all sensors of a link."""

    name: str  #: name of the sensor
    link: str  #: the link that carries it
    pose: Pose = IDENTITY  #: pose of the sensor in that link; it looks along x, and its beams lie in the x-y plane
    update_rate: float = 10.0  #: measurements per second [Hz]; 0 for every step
    #: of its topics, without leading and trailing slashes (``robotNamespace``); None for the robot's
    namespace: str | None = None
    frame: str = ""  #: ``frame_id``, without the tf prefix


@dataclass(frozen=True, slots=True)
class LaserSensor(LinkSensor):
    """A planar laser: ``<sensor type="ray">`` with ``libgazebo_ros_laser.so`` (or the GPU variant)."""

    samples: int = 180  #: beams per scan, the first at ``min_angle``, the last at ``max_angle``
    min_angle: float = -1.5707963267948966
    max_angle: float = 1.5707963267948966
    min_range: float = 0.1  #: minimum reported distance [m]
    max_range: float = 30.0  #: maximum reported distance [m]
    noise_mean: float = 0.0  #: mean of the Gaussian noise [m]
    noise_stddev: float = 0.0  #: standard deviation of the Gaussian noise [m]
    topic: str = "base_scan"  #: relative to the robot's namespace


@dataclass(frozen=True, slots=True)
class SonarSensor(LinkSensor):
    """A range finder with a cone about x: ``<sensor type="ray">`` with ``libgazebo_ros_range.so``."""

    samples: int = 5  #: horizontal rays across the cone; the shortest counts
    fov: float = 0.3490658503988659  #: full opening angle [rad]
    min_range: float = 0.1  #: [m]
    max_range: float = 5.0  #: [m]; also published if nothing is hit
    radiation: str = "ultrasound"  #: ``ultrasound`` or ``infrared``
    gaussianNoise: float = 0.0  #: standard deviation [m]
    topic: str = "sonar"  #: relative to the robot's namespace


@dataclass(frozen=True, slots=True)
class Camera(LinkSensor):
    """``<sensor type="camera">`` with ``libgazebo_ros_camera.so``; ``cameraName`` is its topics' namespace."""

    horizontal_fov: float = 1.3962634  #: [rad]
    width: int = 320  #: [pixel]
    height: int = 240  #: [pixel]
    near: float = 0.02  #: minimum rendered depth [m]
    far: float = 300.0  #: maximum rendered depth [m]
    format: str = "R8G8B8"  #: SDF's name of the pixel format, ``R8G8B8`` or ``L8``
    noise_stddev: float = 0.0  #: Gaussian, of pixel values in 0 … 1
    image_topic: str = "image_raw"  #: relative to ``name``, like the other topics
    info_topic: str = "camera_info"
    hack_baseline: float = (
        0.0  #: distance to the left camera of a stereo pair [m], in ``camera_info``
    )
    depth_topic: str = ""  #: topic of the depth image [m]; empty for none
    depth_info_topic: str = ""  #: topic of the depth image's ``CameraInfo``; empty for none
    cloud_topic: str = ""  #: topic of the depth image as points; empty for none


@dataclass(frozen=True, slots=True)
class GroundTruth:
    """``libgazebo_ros_p3d.so``: the true pose and velocity of one link."""

    name: str
    bodyName: str  #: the link
    topicName: str = "base_pose_ground_truth"  #: relative to the robot's namespace
    #: ``frame_id``: the link that pose and velocity are relative to; ``map`` and ``world`` mean the world's origin
    frameName: str = "map"
    updateRate: float = 10.0  #: [Hz]; 0 for every step
    gaussianNoise: float = 0.0  #: standard deviation of the velocities, as in the plugin
    xyzOffset: Vector = (0.0, 0.0, 0.0)  #: added to the position [m]
    rpyOffset: Vector = (0.0, 0.0, 0.0)  #: added to the rotation [rad]
    #: of its topics, without leading and trailing slashes (``robotNamespace``); None for the robot's
    namespace: str | None = None


@dataclass(frozen=True, slots=True)
class Bumper:
    """``<sensor type="contact">`` with ``libgazebo_ros_bumper.so``."""

    name: str  #: name of the sensor
    link: str  #: the link whose contacts are published
    #: name of the SDF collision; empty for all of the link and of links fixed to it, which Gazebo merges
    collision: str = ""
    bumperTopicName: str = "bumper"  #: relative to the robot's namespace
    frameName: str = "map"  #: ``frame_id``; both ``map`` and ``world`` mean the world's origin
    update_rate: float = 10.0  #: [Hz]
    #: of its topics, without leading and trailing slashes (``robotNamespace``); None for the robot's
    namespace: str | None = None


@dataclass(frozen=True, slots=True)
class JointStatePublisher:
    """``libgazebo_ros_joint_state_publisher.so``."""

    name: str = "joint_state_publisher"
    jointName: tuple[
        str, ...
    ] = ()  #: published joints, in this order; empty for all movable joints
    updateRate: float = 100.0  #: [Hz]; 0 for every step
    topicName: str = "joint_states"  #: relative to the robot's namespace
    #: of its topics, without leading and trailing slashes (``robotNamespace``); None for the robot's
    namespace: str | None = None


POSITION, VELOCITY, EFFORT = "position", "velocity", "effort"


@dataclass(frozen=True, slots=True)
class JointControl:
    """A controller of ros_control that moves joints to a position, at a speed or by an effort."""

    name: str  #: its topic is ``name/command``
    jointName: tuple[str, ...]
    kind: str = POSITION  #: `POSITION`, `VELOCITY` or `EFFORT`
    isGroup: bool = False  #: whether a command has a number for each joint (Float64MultiArray)
    #: of its topics, without leading and trailing slashes (``robotNamespace``); None for the robot's
    namespace: str | None = None


@dataclass(frozen=True, slots=True)
class MimicJoint:
    """A joint that follows another one: URDF's ``<mimic>``, or a mimic joint plugin."""

    name: str
    joint: str  #: the joint that is followed
    mimicJoint: str  #: the joint that follows
    multiplier: float = 1.0
    offset: float = 0.0  #: [rad or m]
    #: of its topics, of which it has none
    namespace: str | None = None


@dataclass(frozen=True, slots=True)
class BaseDriver:
    """``libpioneer_base_driver.so``, ours: publishes base data like the manufacturer's driver (rosaria)."""

    name: str = "base_driver"
    updateRate: float = 2.0  #: rate of the topics [Hz]
    frameName: str = "base_link"  #: ``frame_id`` of bumpers and sonar points, without the tf prefix
    capacity: float = 21.6  #: battery capacity [A h]
    fullVoltage: float = 12.9  #: open-circuit voltage of a full battery [V]
    emptyVoltage: float = 11.4  #: open-circuit voltage of an empty battery [V]
    resistance: float = 0.05  #: internal resistance of the battery [Ω]
    initialCharge: float = 1.0  #: initial charge, 0 … 1
    idlePower: float = 15.0  #: consumption of electronics and sensors [W]
    rollingResistance: float = 3.0  #: rolling resistance force [N]
    driveEfficiency: float = 0.5  #: efficiency of motors and gears, above 0, at most 1
    windingLoss: float = 3.0  #: winding loss of a motor per squared torque [W/(N m)²]
    #: of its topics, without leading and trailing slashes (``robotNamespace``); None for the robot's
    namespace: str | None = None


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
    | JointControl
    | MimicJoint
    | BaseDriver
)
"""A sensor or plugin of a robot."""

Kind = TypeVar("Kind")


@dataclass(frozen=True, slots=True)
class Robot:
    """A complete robot description."""

    name: str  #: name in the file
    #: in file order. A link's pose is its frame in the root link's frame with all joints at 0.
    links: tuple[Link, ...]
    joints: tuple[Joint, ...] = ()  #: in file order; they form a single tree of all links
    devices: tuple[Device, ...] = ()  #: sensors and plugins, in file order
    static: bool = False  #: whether the model is static (``<gazebo><static>``)
    #: one line for each kind of unsupported element that was ignored
    warnings: tuple[str, ...] = ()
    namespace: str = (
        ""  #: topic namespace set by a plugin; used if the robot is spawned without a namespace
    )

    def of(self, kind: type[Kind]) -> tuple[Kind, ...]:
        """Returns the devices of one kind, in file order."""
        return tuple(device for device in self.devices if isinstance(device, kind))

    @property
    def drives(self) -> tuple[DiffDrive, ...]:
        """The wheel drives."""
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
        """The root link, which is not the child of any joint."""
        children = {joint.child for joint in self.joints}
        return next(link for link in self.links if link.name not in children)

    def link(self, name: str) -> Link:
        """Returns the link of that name.

        Raises:
            KeyError: there is no such link.
        """
        return {one.name: one for one in self.links}[name]
