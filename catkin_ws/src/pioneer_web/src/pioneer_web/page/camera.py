"""Fetches single camera images on request of a page."""

import rospy
from sensor_msgs.msg import Image

from pioneer_web.state import conversions

PATIENCE = 5.0
"""Time-out for the next image [s]."""


def image_topics() -> list[str]:
    """Returns the camera image topics on this master."""
    try:
        return sorted(
            topic for topic, kind in rospy.get_published_topics() if kind == "sensor_msgs/Image"
        )
    except (OSError, rospy.ROSException):
        return []


def next_image(topic: str) -> bytes:
    """Returns the next image of a topic as a JPEG; subscribes only while waiting.

    Raises:
        rospy.ROSException: timed out.
        ValueError: the image encoding is not supported.
    """
    return conversions.jpeg_from_image(rospy.wait_for_message(topic, Image, PATIENCE))
