"""ROS messages to and from the values of the core."""

import math
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist

from pioneer_demo.core.floor import Floor, floor_from_cells
from pioneer_demo.core.geometry import Points, Pose, yaw_from_quaternion
from pioneer_demo.core.recording import Hits

BEAMS_KEPT = 180
"""Of each scan for a film, about."""


def pose_from_message(message: Any) -> Pose:
    """Returns a ``geometry_msgs/Pose`` in the plane."""
    turn = message.orientation
    return Pose(message.position.x, message.position.y, yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w))


def pose_from_transform(message: Any) -> Pose:
    """Returns a ``geometry_msgs/Transform`` in the plane."""
    turn, shift = message.rotation, message.translation
    return Pose(shift.x, shift.y, yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w))


def points_from_path(message: Any) -> Points:
    """Returns the positions of a ``nav_msgs/Path``."""
    return [(pose.pose.position.x, pose.pose.position.y) for pose in message.poses]


def floor_from_grid(message: Any) -> Floor:
    """Returns the floor of a ``nav_msgs/OccupancyGrid`` whose ``data`` is an array, of a map that is not turned."""
    cells, corner = message.data.reshape(message.info.height, message.info.width), message.info.origin.position
    return floor_from_cells(cells, message.info.resolution, corner.x, corner.y)


def hits_from_scan(message: Any, mount: Pose) -> Hits:
    """Returns where a ``sensor_msgs/LaserScan``'s beams ended, in the frame that its sensor's ``mount`` is given in."""
    every = max(1, len(message.ranges) // BEAMS_KEPT)
    ranges = np.asarray(message.ranges[::every], np.float32)
    angles = mount.yaw + message.angle_min + np.arange(len(ranges)) * message.angle_increment * every
    met = (ranges >= message.range_min) & (ranges <= message.range_max)
    return np.column_stack([mount.x + ranges * np.cos(angles), mount.y + ranges * np.sin(angles)])[met].astype("f4")


def mount_of(description: str, link: str) -> Pose:
    """Returns where a link of a URDF sits on its root: the joints' origins in the plane, one after the other."""
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


def status_from_message(message: Any) -> str:
    """Returns what an ``actionlib_msgs/GoalStatusArray`` says of its newest goal; empty where it says nothing."""
    return message.status_list[-1].text if message.status_list else ""


def frame_from_message(name: str) -> str:
    """Returns a frame's name without a leading slash."""
    return name.lstrip("/")


def twist_from_goal(goal: Pose) -> Twist:
    """Returns a waypoint as ``map_goal`` takes it: position in ``map`` [m], heading in degrees."""
    twist = Twist()
    twist.linear.x, twist.linear.y, twist.angular.z = goal.x, goal.y, math.degrees(goal.yaw)
    return twist
