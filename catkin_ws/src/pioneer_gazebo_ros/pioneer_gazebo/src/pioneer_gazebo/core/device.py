"""Sensors and plugins of other robots; those of the Pioneer are in `robot`."""

# ruff: noqa: N815 - fields are named after the plugins' elements

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PlanarMove:
    """``libgazebo_ros_planar_move.so``: moves the base in the plane as commanded by a Twist, in any direction."""

    name: str = "planar_move"
    commandTopic: str = "cmd_vel"
    odometryTopic: str = "odom"
    odometryFrame: str = "odom"
    robotBaseFrame: str = "base_footprint"
    odometryRate: float = 20.0  #: [Hz]


@dataclass(frozen=True, slots=True)
class RosControl:
    """``libgazebo_ros_control.so``: replaced by the controllers in the robot's namespace when it is spawned."""

    name: str = "gazebo_ros_control"


@dataclass(frozen=True, slots=True)
class Imu:
    """``libgazebo_ros_imu.so``, ``libgazebo_ros_imu_sensor.so`` or ``libhector_gazebo_ros_imu.so``."""

    name: str
    bodyName: str  #: the link
    topicName: str = "imu"  #: relative to the robot's namespace
    frame: str = ""  #: ``frame_id``, without the tf prefix
    updateRate: float = 0.0  #: [Hz]; 0 for every step
    gaussianNoise: float = 0.0  #: standard deviation of rates [rad/s] and accelerations [m/s²]


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
