"""How ROS 2 names topics and types in DDS.

Source: design.ros2.org, "Topic and Service name mapping to DDS".
"""

_TOPIC_PREFIX = "rt"


def dds_topic(name: str) -> str:
    """Returns the DDS topic of the ROS topic ``name``, which starts with a slash."""
    return f"{_TOPIC_PREFIX}{name}"


def topic_of(dds_name: str) -> str | None:
    """Returns the ROS topic of a DDS topic; None if it is a service, an action or no topic of ROS."""
    if not dds_name.startswith(f"{_TOPIC_PREFIX}/"):
        return None
    return dds_name[len(_TOPIC_PREFIX) :]


def dds_type(type_name: str) -> str:
    """Returns the DDS name of a message type: ``sensor_msgs/Range`` is ``sensor_msgs::msg::dds_::Range_``."""
    package, message = type_name.split("/")
    return f"{package}::msg::dds_::{message}_"


def type_of(dds_name: str) -> str | None:
    """Returns the message type ``package/Name`` of a DDS type; None if it is no message of ROS."""
    package, separator, message = dds_name.partition("::msg::dds_::")
    if not separator or not message.endswith("_"):
        return None
    return f"{package}/{message[:-1]}"


def ros2_type(type_name: str) -> str:
    """Returns a message type as ROS 2 writes it: ``sensor_msgs/Range`` is ``sensor_msgs/msg/Range``."""
    package, message = type_name.split("/")
    return f"{package}/msg/{message}"
