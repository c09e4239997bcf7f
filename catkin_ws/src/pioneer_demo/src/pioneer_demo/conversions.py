"""ROS messages to and from the values of the core."""

import math
from typing import Any

from geometry_msgs.msg import Twist

from pioneer_demo.core.geometry import Pose, yaw_from_quaternion
from pioneer_demo.core.track import ClientState, Points, Queue


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


def queue_from_message(message: Any) -> Queue:
    """Returns a ``simple_navigation_goals/WaypointQueue``'s counts."""
    return Queue(ClientState(message.state), message.received, message.reached, message.aborted, message.text)


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
