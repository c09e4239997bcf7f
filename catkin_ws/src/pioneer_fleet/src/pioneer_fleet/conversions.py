"""ROS messages to values of the core."""

from typing import Any

from pioneer_fleet.core.monitor import ClientState, Queue


def queue_from_message(message: Any) -> Queue:
    """Returns the contents of a ``simple_navigation_goals/WaypointQueue`` that a monitor keeps."""
    waiting = len(message.waiting) + bool(message.current.header.frame_id)
    counts = (message.received, message.reached, message.aborted)
    return Queue(ClientState(message.state), *counts, message.text, waiting)
