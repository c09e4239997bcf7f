"""Converts ROS messages to core values."""

import xml.etree.ElementTree as ElementTree
from typing import Any

from pioneer_fleet.core.geometry import Points, Pose, yaw_from_quaternion
from pioneer_fleet.core.monitor import ClientState, Queue


def queue_from_message(message: Any) -> Queue:
    """Returns the `Queue` of a ``simple_navigation_goals/WaypointQueue``."""
    waiting = len(message.waiting) + bool(message.current.header.frame_id)
    counts = (message.received, message.reached, message.aborted)
    return Queue(ClientState(message.state), *counts, message.text, waiting)


def pose_from_message(message: Any) -> Pose:
    """Returns a ``geometry_msgs/Pose`` projected to 2D."""
    turn = message.orientation
    return Pose(message.position.x, message.position.y, yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w))


def pose_from_transform(message: Any) -> Pose:
    """Returns a ``geometry_msgs/Transform`` projected to 2D."""
    turn, shift = message.rotation, message.translation
    return Pose(shift.x, shift.y, yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w))


def points_from_path(message: Any) -> Points:
    """Returns the positions of a ``nav_msgs/Path``."""
    return [(pose.pose.position.x, pose.pose.position.y) for pose in message.poses]


def mount_of(description: str, link: str) -> Pose:
    """Returns the 2D pose of a URDF link relative to the root link, by composing the joint origins."""
    joints = dict[str, tuple[str, Pose]]()
    for joint in ElementTree.fromstring(description).iter("joint"):
        parent, child, origin = joint.find("parent"), joint.find("child"), joint.find("origin")
        if parent is not None and child is not None:
            place = {} if origin is None else origin.attrib
            x, y, _ = map(float, place.get("xyz", "0 0 0").split())
            *_, yaw = map(float, place.get("rpy", "0 0 0").split())
            joints[child.get("link", "")] = parent.get("link", ""), Pose(x, y, yaw)
    pose, name = Pose(0.0, 0.0), link
    while name in joints:
        name, step = joints[name]
        pose = step.compose(pose)
    return pose


def frame_from_message(name: str) -> str:
    """Returns a frame's name without a leading slash."""
    return name.lstrip("/")
