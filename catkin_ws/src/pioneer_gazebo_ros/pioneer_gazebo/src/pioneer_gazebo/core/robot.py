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
    """``libgazebo_ros_diff_drive.so``: drives two wheels by a Twist and publishes odometry."""

    name: str = "diff_drive"
    leftJoint: str = "left_joint"  #: wheel joint on the left, and so on; every other name is the plugin's element
    rightJoint: str = "right_joint"
    wheelSeparation: float = 0.34  #: between the wheels' contact points [m]
    wheelDiameter: float = 0.15  #: [m]
    wheelAcceleration: float = 0.0  #: largest change of a wheel's rim speed [m/s²]; 0 for no limit
    wheelTorque: float = 5.0  #: largest torque at a wheel [N m]
    #: without a command for longer the wheels stop [s]; 0 for never (ours, not gazebo_ros')
    commandTimeout: float = 0.0
    updateRate: float = 100.0  #: of commands and odometry [Hz]; 0 for every step
    commandTopic: str = "cmd_vel"
    odometryTopic: str = "odom"
    odometryFrame: str = "odom"
    robotBaseFrame: str = "base_footprint"
    odometrySource: str = "world"  #: ``encoder`` (integrates the wheels) or ``world`` (the true pose)
    publishTf: bool = True
    publishOdomTF: bool = True
    publishWheelTF: bool = False
    publishWheelJointState: bool = False
    legacyMode: str = ""  #: ``true`` if the joint called left is on the right; empty: as the joints lie
    #: further wheels on the left, as ``libgazebo_ros_skid_steer_drive.so`` has; so ``rightRearJoint``
    leftRearJoint: tuple[str, ...] = ()
    rightRearJoint: tuple[str, ...] = ()
    speedLimits: Limits = NO_LIMITS  #: of the commanded speed, as ``diff_drive_controller`` has; so ``turnLimits``
    turnLimits: Limits = NO_LIMITS

    def joints(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Returns the names of the joints that are called left and right."""
        return (self.leftJoint, *self.leftRearJoint), (self.rightJoint, *self.rightRearJoint)


@dataclass(frozen=True, slots=True)
class LinkSensor:
    """What all sensors of a link have."""

    name: str  #: the sensor's
    link: str  #: the link that carries it
    pose: Pose = IDENTITY  #: of the sensor in that link; it looks along x, and its beams lie in the x-y plane
    update_rate: float = 10.0  #: measurements a second; 0 for every step
    frame: str = ""  #: ``frame_id``, before the prefix


@dataclass(frozen=True, slots=True)
class LaserSensor(LinkSensor):
    """A planar laser: ``<sensor type="ray">`` with ``libgazebo_ros_laser.so`` (or the gpu one)."""

    samples: int = 180  #: beams a scan, the first at ``min_angle``, the last at ``max_angle``
    min_angle: float = -1.5707963267948966
    max_angle: float = 1.5707963267948966
    min_range: float = 0.1  #: nearest distance that is reported [m]
    max_range: float = 30.0  #: farthest distance that is reported [m]
    resolution: float = 0.0  #: step of a range [m]; 0 for none
    noise_mean: float = 0.0  #: of the gaussian noise [m]
    noise_stddev: float = 0.0  #: of the gaussian noise [m]
    topic: str = "base_scan"  #: relative to the robot's namespace


@dataclass(frozen=True, slots=True)
class SonarSensor(LinkSensor):
    """A range finder with a cone about x: ``<sensor type="ray">`` with ``libgazebo_ros_range.so``."""

    samples: int = 5  #: rays across the cone (horizontal) that find the nearest thing
    fov: float = 0.3490658503988659  #: full opening angle [rad]
    min_range: float = 0.1  #: [m]
    max_range: float = 5.0  #: [m]; also what is published when nothing is met
    radiation: str = "ultrasound"  #: ``ultrasound`` or ``infrared``
    gaussianNoise: float = 0.0  #: standard deviation [m]
    topic: str = "sonar"  #: relative to the robot's namespace


@dataclass(frozen=True, slots=True)
class Camera(LinkSensor):
    """``<sensor type="camera">`` with ``libgazebo_ros_camera.so``; ``cameraName`` is its topics' namespace."""

    horizontal_fov: float = 1.3962634  #: [rad]
    width: int = 320  #: [pixel]
    height: int = 240  #: [pixel]
    near: float = 0.02  #: nearest depth that is drawn [m]
    far: float = 300.0  #: farthest [m]
    format: str = "R8G8B8"  #: SDF's name of the pixel format, ``R8G8B8`` or ``L8``
    noise_stddev: float = 0.0  #: gaussian, of a pixel's value in 0 … 1
    image_topic: str = "image_raw"  #: relative to ``name``; so the other topics
    info_topic: str = "camera_info"
    depth_topic: str = ""  #: of the picture's distances [m]; empty for none
    cloud_topic: str = ""  #: of the same as points; empty for none


@dataclass(frozen=True, slots=True)
class GroundTruth:
    """``libgazebo_ros_p3d.so``: the true pose and velocity of one link."""

    name: str
    bodyName: str  #: the link
    topicName: str = "base_pose_ground_truth"  #: relative to the robot's namespace
    frameName: str = "map"  #: ``frame_id``: ``map`` and ``world`` both mean the world's origin
    updateRate: float = 10.0  #: [Hz]; 0 for every step
    gaussianNoise: float = 0.0  #: standard deviation of the velocities, as the plugin does it
    xyzOffset: Vector = (0.0, 0.0, 0.0)  #: added to the position [m]
    rpyOffset: Vector = (0.0, 0.0, 0.0)  #: added to the rotation [rad]


@dataclass(frozen=True, slots=True)
class Bumper:
    """``<sensor type="contact">`` with ``libgazebo_ros_bumper.so``."""

    name: str  #: the sensor's
    link: str  #: the link whose contacts are published
    #: SDF's name of the collision; empty for all of the link and of what is fixed to it, as Gazebo lumps them
    collision: str = ""
    bumperTopicName: str = "bumper"  #: relative to the robot's namespace
    frameName: str = "map"  #: ``frame_id``: ``map`` and ``world`` both mean the world's origin
    update_rate: float = 10.0  #: [Hz]


@dataclass(frozen=True, slots=True)
class JointStatePublisher:
    """``libgazebo_ros_joint_state_publisher.so``."""

    name: str = "joint_state_publisher"
    jointName: tuple[str, ...] = ()  #: joints that are published, in this order; empty for every joint that moves
    updateRate: float = 100.0  #: [Hz]; 0 for every step
    topicName: str = "joint_states"  #: relative to the robot's namespace


@dataclass(frozen=True, slots=True)
class BaseDriver:
    """``libpioneer_base_driver.so``, ours: what the maker's driver (rosaria) publishes about the robot's base."""

    name: str = "base_driver"
    updateRate: float = 2.0  #: of the topics [Hz]
    frameName: str = "base_link"  #: ``frame_id`` of bumpers and sonar points, before the prefix
    capacity: float = 21.6  #: of the battery [A h]
    fullVoltage: float = 12.9  #: of a full battery without load [V]
    emptyVoltage: float = 11.4  #: of an empty one [V]
    resistance: float = 0.05  #: inside the battery [Ω]
    initialCharge: float = 1.0  #: 0 … 1
    idlePower: float = 15.0  #: what electronics and sensors draw [W]
    rollingResistance: float = 3.0  #: force that rolling takes [N]
    driveEfficiency: float = 0.5  #: of motors and gears, above 0, at most 1
    windingLoss: float = 3.0  #: what torque costs a motor [W/(N m)²]


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
    """A whole robot."""

    name: str  #: as the file names it
    #: in the file's order. A link's pose is that of its frame in the root link's frame, all joints at 0.
    links: tuple[Link, ...]
    joints: tuple[Joint, ...] = ()  #: in the file's order; they make one tree over all links
    devices: tuple[Device, ...] = ()  #: sensors and plugins, in the file's order
    static: bool = False  #: the model never moves (``<gazebo><static>``)
    #: one line for each kind of thing in the file that is not supported and was left out
    warnings: tuple[str, ...] = ()
    namespace: str = ""  #: that a plugin names for its topics; it counts where the robot is spawned without one

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
