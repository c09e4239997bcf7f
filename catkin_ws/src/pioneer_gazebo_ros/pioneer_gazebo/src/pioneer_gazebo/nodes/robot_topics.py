"""What one robot publishes and subscribes to, each topic at its own rate and only while it has subscribers."""

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
"""What starts the topics of each kind of device."""


class RobotTopics:
    """One robot's topics.

    Subscribes, publishes: what each of its devices does (`TOPICS`), and ``collisions`` (std_msgs/UInt32, latched).
    Threads: all but the subscribers' callbacks, which only store a command, run in the simulation's thread.
    On error: a command that is not finite is logged at most once a second, and the last one holds.
    """

    def __init__(self, context: Context, entity: Entity) -> None:
        """Starts the topics of every device of the robot.

        Raises:
            RateError: a rate does not divide the simulator's; nothing is left behind.
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
        """Restarts what depends on time."""
        for restart in self._port.on_reset:
            restart()
        self.publish_collisions()

    def publish_collisions(self) -> None:
        """Publishes how often the robot has collided since it was spawned."""
        publish_while_alive(self._collisions, UInt32(self._entity.collisions.count))
