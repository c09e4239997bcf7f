"""Topics of one robot, each published at its own rate and only while it has subscribers."""

from collections.abc import Callable
from typing import Any

import rospy
from std_msgs.msg import UInt32

from pioneer_gazebo.core import robot as kinds
from pioneer_gazebo.core.device import Gps, Imu, PlanarMove
from pioneer_gazebo.core.entity import Entity
from pioneer_gazebo.nodes.camera_topics import camera_topics
from pioneer_gazebo.nodes.drive_topics import drive_topics
from pioneer_gazebo.nodes.driver_topics import driver_topics
from pioneer_gazebo.nodes.other_topics import gps_topics, imu_topics, planar_topics
from pioneer_gazebo.nodes.port import Context, Port
from pioneer_gazebo.nodes.sensor_topics import (
    bumper_topics,
    joint_state_topics,
    laser_topics,
    sonar_topics,
    truth_topics,
)
from pioneer_gazebo.nodes.topic import publish_while_alive

TOPICS: dict[type, Callable[[Port, Any], object]] = {
    kinds.DiffDrive: drive_topics,
    PlanarMove: planar_topics,
    Imu: imu_topics,
    Gps: gps_topics,
    kinds.LaserSensor: laser_topics,
    kinds.SonarSensor: sonar_topics,
    kinds.Camera: camera_topics,
    kinds.GroundTruth: truth_topics,
    kinds.Bumper: bumper_topics,
    kinds.JointStatePublisher: joint_state_topics,
    kinds.BaseDriver: driver_topics,
}
"""Maps device types to the functions that start their topics."""


class RobotTopics:
    """The topics of one robot.

    Subscribes, publishes: the topics of its devices (`TOPICS`), and ``collisions`` (std_msgs/UInt32, latched).
    Threads: everything runs in the simulation's thread, except for subscriber callbacks, which only store a command.
    On error: a non-finite command is logged at most once a second; the previous command remains in force.
    """

    def __init__(self, context: Context, entity: Entity) -> None:
        """Starts the topics of all devices of the robot.

        Raises:
            RateError: a rate does not divide the tick rate; all topics are removed again.
        """
        assert entity.robot is not None, "only a robot has topics"
        self._entity = entity
        self._port = Port(context, entity)
        try:
            for device in entity.robot.devices:
                TOPICS[type(device)](self._port, device)
        except Exception:
            self._port.close()
            raise
        self._collisions: rospy.Publisher = self._port.latched("collisions", UInt32(entity.collisions.count))

    def close(self) -> None:
        """Removes all topics."""
        self._port.close()

    def reset(self) -> None:
        """Resets devices whose state depends on time, and republishes the collision count."""
        for restart in self._port.on_reset:
            restart()
        self.publish_collisions()

    def publish_collisions(self) -> None:
        """Publishes the number of collisions since the robot was spawned."""
        publish_while_alive(self._collisions, UInt32(self._entity.collisions.count))
