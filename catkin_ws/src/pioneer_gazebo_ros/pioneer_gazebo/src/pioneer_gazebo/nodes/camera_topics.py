"""Publishes a camera's images and intrinsics; renders only while there are subscribers."""

from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from pioneer_gazebo import conversions
from pioneer_gazebo.core.camera import noisy, points_of
from pioneer_gazebo.core.laser import generator_for
from pioneer_gazebo.core.robot import Camera
from pioneer_gazebo.core.schedule import nanoseconds
from pioneer_gazebo.nodes.port import Port
from pioneer_gazebo.nodes.topic import Topic


def camera_topics(port: Port, config: Camera) -> None:
    """Publishes ``image_raw`` (Image) and ``camera_info`` (CameraInfo) below the camera's name, with equal stamps.

    A depth camera also publishes depth (Image, 32FC1) and points (PointCloud2). The simulation waits for each image; if
    rendering takes too much time, images are dropped (`Budget`).
    """
    simulation, frame = port.simulation, port.frame(config.frame)
    noise = generator_for(0, port.entity.name, config.name)
    image = port.topic(f"{config.name}/{config.image_topic}", Image)
    info = port.topic(f"{config.name}/{config.info_topic}", CameraInfo)
    intrinsics = conversions.info_of(config)

    depth = port.topic(f"{config.name}/{config.depth_topic}", Image) if config.depth_topic else None
    cloud = port.topic(f"{config.name}/{config.cloud_topic}", PointCloud2) if config.cloud_topic else None

    def send(topic: Topic | None, tick: int, make: Callable[[], Any]) -> None:
        if topic is not None and topic.wanted:
            topic.send(conversions.stamped_frame(make(), nanoseconds(tick), frame))

    def publish_image(tick: int) -> None:
        def draw() -> None:
            eye = simulation.link_pose(port.entity, config.link).compose(config.pose)
            moving = [(entity, simulation.part_poses(entity)) for entity in simulation.entities()]
            picture, far = port.context.renderer().picture(config, eye, simulation.standing_models(), moving)
            seen = noisy(picture, config.noise_stddev, noise)
            send(image, tick, lambda: conversions.image_of(seen, config))
            send(depth, tick, lambda: conversions.depth_of(far))
            send(cloud, tick, lambda: conversions.cloud_of(points_of(far, config)))

        port.context.budget.draw(f"{port.entity.name}/{config.name}", draw)

    def publish_info(tick: int) -> None:
        info.send(conversions.stamped_frame(intrinsics, nanoseconds(tick), frame))

    port.every(config.update_rate, config.image_topic, publish_image, *filter(None, (image, depth, cloud)))
    port.every(config.update_rate, config.info_topic, publish_info, info)
