"""ROS messages to and from the values of the core."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist

from pioneer_demo.core.floor import Floor, floor_from_cells
from pioneer_demo.core.recording import Hits
from pioneer_fleet.conversions import pose_from_message
from pioneer_fleet.core.geometry import Pose

BEAMS_KEPT = 180
"""Of each scan for a film, about."""


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


def counters_from_diagnostics(message: Any) -> Iterator[tuple[str, int, int]]:
    """Yields name, messages and bytes so far of each gateway's connection in a ``diagnostic_msgs/DiagnosticArray``."""
    for status in message.status:
        values = {one.key: one.value for one in status.values}
        if {"messages", "bytes"} <= values.keys():
            yield status.name, int(values["messages"]), int(values["bytes"])


def speed_from_truth(message: Any) -> tuple[float, float]:
    """Returns the speeds forwards [m/s] and anticlockwise [rad/s] of a robot's ``base_pose_ground_truth``.

    The p3d plugin gives velocities in the world's frame, unlike odometry.
    """
    pose, velocity = pose_from_message(message.pose.pose), message.twist.twist
    forwards = math.cos(pose.yaw) * velocity.linear.x + math.sin(pose.yaw) * velocity.linear.y
    return forwards, velocity.angular.z


def status_from_message(message: Any) -> str:
    """Returns what an ``actionlib_msgs/GoalStatusArray`` says of its newest goal; empty where it says nothing."""
    return message.status_list[-1].text if message.status_list else ""


def twist_from_goal(goal: Pose) -> Twist:
    """Returns a waypoint as ``map_goal`` takes it: position in ``map`` [m], heading in degrees."""
    twist = Twist()
    twist.linear.x, twist.linear.y, twist.angular.z = goal.x, goal.y, math.degrees(goal.yaw)
    return twist
