"""Conversions between messages and waypoints or their queue."""

import math
from typing import Any

from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist
from std_msgs.msg import Header

from pioneer_node.core.frame import stripped
from simple_navigation_goals.msg import WaypointQueue as WaypointQueueMessage
from simple_navigation_goals.queue import WaypointQueue
from simple_navigation_goals.waypoint import Waypoint, yaw_from_quaternion


def waypoint_from_twist(message: Twist, frame: str) -> Waypoint:
    """Returns linear.x, linear.y [m] and angular.z, a heading in DEGREES, as a waypoint in ``frame``.

    Raises:
        WaypointError: one of the three is not finite.
    """
    return Waypoint(message.linear.x, message.linear.y, math.radians(message.angular.z), frame)


def waypoint_from_pose(message: PoseStamped, frame: str) -> Waypoint:
    """Returns a PoseStamped as a waypoint in the frame of its header, or in ``frame`` if that is empty.

    Height, roll, pitch and stamp are dropped.

    Raises:
        WaypointError: a number is not finite, or the orientation is not a rotation.
    """
    position, turn = message.pose.position, message.pose.orientation
    yaw = yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w)
    return Waypoint(position.x, position.y, yaw, stripped(message.header.frame_id) or frame)


def pose_from_waypoint(waypoint: Waypoint, stamp: Any) -> PoseStamped:
    """Returns ``waypoint`` as a PoseStamped at ``stamp`` (genpy.Time)."""
    turn = Quaternion(0.0, 0.0, math.sin(waypoint.yaw / 2.0), math.cos(waypoint.yaw / 2.0))
    return PoseStamped(
        Header(0, stamp, waypoint.frame), Pose(Point(waypoint.x, waypoint.y, 0.0), turn)
    )


def message_from_queue(queue: WaypointQueue, frame: str, stamp: Any) -> WaypointQueueMessage:
    """Returns the status of ``queue`` at ``stamp`` (genpy.Time); ``frame`` is the default frame of its waypoints."""
    return WaypointQueueMessage(
        header=Header(0, stamp, frame),
        state=int(queue.phase),
        received=queue.received,
        reached=queue.reached,
        aborted=queue.aborted,
        current=pose_from_waypoint(queue.current, stamp) if queue.current else PoseStamped(),
        waiting=[pose_from_waypoint(waypoint, stamp) for waypoint in queue.waiting],
        text=queue.text,
    )
