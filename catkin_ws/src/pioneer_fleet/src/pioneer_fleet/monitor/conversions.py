"""Converts ROS messages to core values."""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from typing import Any

from pioneer_fleet.geometry import Points, Pose, yaw_from_quaternion
from pioneer_fleet.monitor.client import ClientState, Queue
from pioneer_fleet.monitor.state import Activity, State

FARTHEST = 1e6
"""Maximum coordinate of a position [m]."""
LARGEST = 1e15
"""Maximum of a number that is shown."""
AT_ROBOT = 0.8
"""A place that is nearer to a robot than this is where that robot is [m]."""
_STATES = {state.value: state for state in ClientState}
_ACTIVITIES = {activity.value: activity for activity in Activity}


class MessageError(ValueError):
    """A message has values that cannot be used; the text names the field."""


def queue_from_message(message: Any) -> Queue:
    """Returns the `Queue` of a ``simple_navigation_goals/WaypointQueue``; a state that is not known is UNKNOWN."""
    waiting = len(message.waiting) + bool(message.current.header.frame_id)
    counts = (message.received, message.reached, message.aborted)
    return Queue(_STATES.get(message.state, ClientState.UNKNOWN), *counts, message.text, waiting)


def state_from_message(message: Any, others: Mapping[str, Pose]) -> State:
    """Returns the `State` of a ``nav_bundle/NavigationState``; a number that is not known counts as BLOCKED.

    A robot that does not know the others names an obstacle without its name, which is added here.

    Args:
        message: the newest state of move_base or of the right of way.
        others: the other robots' poses in ``map``, by name.
    """
    robot = _unnamed_robot(message, others)
    text = f"{message.text}: {robot} is there" if robot else str(message.text)
    return State(_ACTIVITIES.get(message.state, Activity.BLOCKED), text)


def _unnamed_robot(message: Any, others: Mapping[str, Pose]) -> str:
    """Returns the name of the robot at the place that a state names, if the state has none; else empty."""
    is_obstacle = message.reason in (message.WAY_BLOCKED, message.GOAL_OCCUPIED)
    if message.robot or not message.has_place or not is_obstacle:
        return ""
    place = message.place.x, message.place.y
    distances = {name: math.dist(place, (pose.x, pose.y)) for name, pose in others.items()}
    nearest = min(distances, key=distances.__getitem__, default="")
    return nearest if nearest and distances[nearest] < AT_ROBOT else ""


def pose_from_message(message: Any) -> Pose:
    """Returns a ``geometry_msgs/Pose`` projected to 2D.

    Raises:
        MessageError: it is not finite or too far away.
    """
    return _pose(message.position, message.orientation)


def pose_from_transform(message: Any) -> Pose:
    """Returns a ``geometry_msgs/Transform`` projected to 2D.

    Raises:
        MessageError: it is not finite or too far away.
    """
    return _pose(message.translation, message.rotation)


def points_from_path(message: Any) -> Points:
    """Returns the positions of a ``nav_msgs/Path``, without those that are not finite or too far away."""
    positions = [pose.pose.position for pose in message.poses]
    return [(place.x, place.y) for place in positions if is_near(place.x) and is_near(place.y)]


def is_near(value: float) -> bool:
    """Returns whether a coordinate [m] is finite and not too far away."""
    return -FARTHEST <= value <= FARTHEST


def mount_of(description: str, link: str) -> Pose:
    """Returns the 2D pose of a URDF link relative to the root link, by composing the joint origins.

    Raises:
        MessageError: the description is not a URDF.
    """
    joints = dict[str, tuple[str, Pose]]()
    if isinstance(description, str) and "<!DOCTYPE" in description:
        raise MessageError("the robot description has a document type, whose entities may expand")
    try:
        root = ElementTree.fromstring(description)
    except (ElementTree.ParseError, TypeError) as error:
        raise MessageError(f"the robot description is not XML: {error}") from None
    for joint in root.iter("joint"):
        parent, child, origin = joint.find("parent"), joint.find("child"), joint.find("origin")
        if parent is not None and child is not None:
            place = {} if origin is None else origin.attrib
            x, y, _ = map(float, place.get("xyz", "0 0 0").split())
            *_, yaw = map(float, place.get("rpy", "0 0 0").split())
            joints[child.get("link", "")] = parent.get("link", ""), Pose(x, y, yaw)
    pose, name = Pose(0.0, 0.0), link
    while name in joints:
        name, step = joints.pop(name)  # each joint once, even if they form a circle
        pose = step.compose(pose)
    return pose


def finite(value: float, name: str) -> float:
    """Returns a number of a message.

    Raises:
        MessageError: it is not finite or too large to be meant.
    """
    if not abs(value) <= LARGEST:
        raise MessageError(f"{name} must be a number of at most {LARGEST:g}, not {value:g}")
    return value


def _pose(place: Any, turn: Any) -> Pose:
    yaw = yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w)
    if not is_near(place.x) or not is_near(place.y) or not math.isfinite(yaw):
        raise MessageError(
            f"a pose is not finite or beyond {FARTHEST:g} m: ({place.x:g}, {place.y:g}), yaw {yaw:g}"
        )
    return Pose(place.x, place.y, yaw)


def frame_from_message(name: str) -> str:
    """Returns a frame's name without a leading slash."""
    return name.lstrip("/")
