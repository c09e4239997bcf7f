"""A robot's camera: pictures and their intrinsics, drawn only while something subscribes."""

import rospy
from sensor_msgs.msg import CameraInfo, Image

from pioneer_gazebo import conversions
from pioneer_gazebo.core.camera import noisy
from pioneer_gazebo.core.laser import generator_for
from pioneer_gazebo.core.robot import Camera
from pioneer_gazebo.core.schedule import nanoseconds
from pioneer_gazebo.nodes.port import Port


def camera_topics(port: Port, config: Camera) -> None:
    """Publishes ``image_raw`` (Image) and ``camera_info`` (CameraInfo) below the camera's name, with the same stamps.

    The simulation waits for each picture.
    """
    simulation, frame = port.simulation, port.frame(config.frame)
    noise = generator_for(0, port.entity.name, config.name)
    image = port.topic(f"{config.name}/{config.image_topic}", Image)
    info = port.topic(f"{config.name}/{config.info_topic}", CameraInfo)
    intrinsics = conversions.info_of(config)
    intrinsics.header.frame_id = frame

    def publish_image(tick: int) -> None:
        eye = simulation.link_pose(port.entity, config.link).compose(config.pose)
        moving = [(entity, simulation.part_poses(entity)) for entity in simulation.entities()]
        picture = port.context.renderer().picture(config, eye, simulation.standing_models(), moving)
        message = conversions.image_of(noisy(picture, config.noise_stddev, noise), config)
        message.header.frame_id = frame
        message.header.stamp = rospy.Time(*conversions.seconds_nanoseconds(nanoseconds(tick)))
        image.send(conversions.frame_of(message))

    def publish_info(tick: int) -> None:
        intrinsics.header.stamp = rospy.Time(*conversions.seconds_nanoseconds(nanoseconds(tick)))
        info.send(conversions.frame_of(intrinsics))

    port.every(config.update_rate, config.image_topic, publish_image, image)
    port.every(config.update_rate, config.info_topic, publish_info, info)
