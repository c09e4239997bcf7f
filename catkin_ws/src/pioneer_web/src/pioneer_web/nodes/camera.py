"""Camera images, one at a time, when a page asks for them."""

import base64

import rospy
from sensor_msgs.msg import Image

from pioneer_web import conversions

PATIENCE = 5.0
"""For the next image [s]."""


def image_topics() -> list[str]:
    """Returns the topics with camera images on this master."""
    try:
        return sorted(topic for topic, kind in rospy.get_published_topics() if kind == "sensor_msgs/Image")
    except (OSError, rospy.ROSException):
        return []


def next_image(topic: str) -> str:
    """Returns the next image of a topic as the address of a JPEG; subscribes for that long.

    Raises:
        rospy.ROSException: none came.
        ValueError: it has an encoding that cannot be shown.
    """
    message = rospy.wait_for_message(topic, Image, PATIENCE)
    return "data:image/jpeg;base64," + base64.b64encode(conversions.jpeg_from_image(message)).decode()
