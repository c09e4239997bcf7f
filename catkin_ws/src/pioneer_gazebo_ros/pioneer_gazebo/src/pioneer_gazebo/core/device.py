"""Sensors and plugins of robots other than the Pioneer; those of the Pioneer are in `robot`."""

# ruff: noqa: N815 - fields are named as the plugins' elements are

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PlanarMove:
    """``libgazebo_ros_planar_move.so``: moves the base in the plane by a Twist, in any direction.

    Attributes:
        odometryRate: [Hz].
    """

    name: str = "planar_move"
    commandTopic: str = "cmd_vel"
    odometryTopic: str = "odom"
    odometryFrame: str = "odom"
    robotBaseFrame: str = "base_footprint"
    odometryRate: float = 20.0


@dataclass(frozen=True, slots=True)
class RosControl:
    """``libgazebo_ros_control.so``: the controllers in the robot's namespace take its place when it is spawned."""

    name: str = "gazebo_ros_control"


@dataclass(frozen=True, slots=True)
class Imu:
    """``libgazebo_ros_imu.so``, ``libgazebo_ros_imu_sensor.so`` or ``libhector_gazebo_ros_imu.so``.

    Attributes:
        bodyName: the link.
        topicName: relative to the robot's namespace.
        frame: ``frame_id``, before the prefix.
        updateRate: [Hz]; 0 for every step.
        gaussianNoise: standard deviation of rates [rad/s] and accelerations [m/s²].
    """

    name: str
    bodyName: str
    topicName: str = "imu"
    frame: str = ""
    updateRate: float = 0.0
    gaussianNoise: float = 0.0


@dataclass(frozen=True, slots=True)
class Gps:
    """``libhector_gazebo_ros_gps.so``: position and velocity on the globe.

    Attributes:
        bodyName: the link.
        frameId: ``frame_id``, as it is.
        referenceLatitude: of the world's origin [deg], north.
        referenceLongitude: of the world's origin [deg], east.
        referenceAltitude: of the world's origin [m].
        referenceHeading: of the world's x axis [deg] from north, clockwise.
        updateRate: [Hz]; 0 for every step.
    """

    name: str
    bodyName: str
    topicName: str = "fix"
    velocityTopicName: str = "fix_velocity"
    frameId: str = "/world"
    referenceLatitude: float = 49.9
    referenceLongitude: float = 8.9
    referenceAltitude: float = 0.0
    referenceHeading: float = 0.0
    updateRate: float = 4.0
