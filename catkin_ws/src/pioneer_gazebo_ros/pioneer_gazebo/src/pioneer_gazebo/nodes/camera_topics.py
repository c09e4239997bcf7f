"""A robot's camera: pictures and what they mean, drawn only while somebody looks."""

from collections.abc import Callable
from typing import Protocol

import rospy
from sensor_msgs.msg import CameraInfo, Image

from pioneer_gazebo import conversions
from pioneer_gazebo.core.camera import Renderer, noisy
from pioneer_gazebo.core.entity import Entity
from pioneer_gazebo.core.laser import generator_for
from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.core.robot import Camera
from pioneer_gazebo.core.schedule import nanoseconds
from pioneer_gazebo.core.simulation import Simulation
from pioneer_gazebo.nodes.topic import Topic


class Every(Protocol):
    """Has an action run at a rate while a topic is wanted."""

    def __call__(self, rate: float, what: str, action: Callable[[int], None], topic: Topic) -> None:
        """Schedules it."""


class CameraTopics:
    """One camera.

    Publishes: ``image_raw`` (sensor_msgs/Image) and ``camera_info`` (sensor_msgs/CameraInfo) below the camera's name,
        with the same stamps.
    Threads: all runs in the simulation's thread, which waits for each picture.
    """

    def __init__(
        self, simulation: Simulation, entity: Entity, config: Camera, renderer: Callable[[], Renderer]
    ) -> None:
        """Takes what is looked at and what draws it; ``renderer`` is asked at the first picture."""
        self._simulation, self._entity, self._config, self._renderer = simulation, entity, config, renderer
        self._noise = generator_for(0, entity.name, config.name)

    def start(self, advertise: Callable[[str, type], Topic], every: Every, frame: str) -> None:
        """Advertises and schedules; ``frame`` is the header's: x to the right of the picture, y down."""
        config = self._config
        image = advertise(f"{config.name}/{config.image_topic}", Image)
        info = advertise(f"{config.name}/{config.info_topic}", CameraInfo)
        meaning = conversions.info_of(config)
        meaning.header.frame_id = frame

        def publish_image(tick: int) -> None:
            message = self._image()
            message.header.frame_id = frame
            message.header.stamp = rospy.Time(*conversions.seconds_nanoseconds(nanoseconds(tick)))
            image.send(conversions.frame_of(message))

        def publish_info(tick: int) -> None:
            meaning.header.stamp = rospy.Time(*conversions.seconds_nanoseconds(nanoseconds(tick)))
            info.send(conversions.frame_of(meaning))

        every(config.update_rate, config.image_topic, publish_image, image)
        every(config.update_rate, config.info_topic, publish_info, info)

    def _image(self) -> Image:
        simulation, config = self._simulation, self._config
        eye = simulation.link_pose(self._entity, config.link).compose(config.pose)
        standing = [model for model in map(simulation.standing, simulation.names()) if model is not None]
        moving = [(entity, _part_poses(simulation, entity)) for entity in simulation.entities()]
        picture = self._renderer().picture(config, eye, standing, moving)
        return conversions.image_of(noisy(picture, config.noise_stddev, self._noise), config)


def _part_poses(simulation: Simulation, entity: Entity) -> list[Pose]:
    """Returns the pose of each part; a part without links, which has no looks either, stands at the base."""
    poses = []
    for part in entity.body.parts:
        if part.frames:
            link, at = part.frames[0]
            poses.append(simulation.link_pose(entity, link).compose(at.inverse()))
        else:
            poses.append(simulation.pose(entity))
    return poses
