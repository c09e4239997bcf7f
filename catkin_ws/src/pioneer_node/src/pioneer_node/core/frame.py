"""Names of coordinate frames, as tf2 stores them: without a leading slash."""


def stripped(frame: str) -> str:
    """Returns ``frame`` without its leading slash: tf2 stores ``/map`` as ``map`` and rejects look-ups of ``/map``."""
    return frame[1:] if frame.startswith("/") else frame


def resolved(prefix: str, frame: str) -> str:
    """Returns ``frame`` under ``tf_prefix`` ``prefix``, as ``tf::resolve`` of ROS 1 does.

    A frame with a leading slash is absolute and gets no prefix; its slash is still dropped.
    """
    if frame.startswith("/") or not prefix.strip("/"):
        return stripped(frame)
    return f"{prefix.strip('/')}/{frame}"


def prefixed(prefix: str, frame: str) -> str:
    """Returns a robot's frame ("odom", "base_link") under its ``tf_prefix``, unless it already carries it."""
    prefix = prefix.strip("/")
    return stripped(frame) if frame.startswith(f"{prefix}/") else resolved(prefix, frame)
