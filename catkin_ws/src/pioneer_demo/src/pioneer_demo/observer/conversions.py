"""Converts between ROS messages and core values."""

import contextlib
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist

from pioneer_demo.observer.recording import Hits
from pioneer_demo.scenario.floor import Floor, floor_from_cells
from pioneer_fleet.geometry import Pose
from pioneer_fleet.monitor.conversions import pose_from_message

BEAMS_KEPT = 180
"""Approximate number of beams kept per scan for a video."""


def floor_from_grid(message: Any) -> Floor:
    """Returns the floor of an unrotated ``nav_msgs/OccupancyGrid`` whose ``data`` is a numpy array."""
    cells, corner = (
        message.data.reshape(message.info.height, message.info.width),
        message.info.origin.position,
    )
    return floor_from_cells(cells, message.info.resolution, corner.x, corner.y)


def hits_from_scan(message: Any, mount: Pose) -> Hits:
    """Returns the end points of a ``sensor_msgs/LaserScan``'s beams, in the parent frame of the sensor's ``mount``."""
    every = max(1, len(message.ranges) // BEAMS_KEPT)
    ranges = np.asarray(message.ranges[::every], np.float32)
    angles = (
        mount.yaw + message.angle_min + np.arange(len(ranges)) * message.angle_increment * every
    )
    met = (ranges >= message.range_min) & (ranges <= message.range_max)
    return np.column_stack([mount.x + ranges * np.cos(angles), mount.y + ranges * np.sin(angles)])[
        met
    ].astype("f4")


def counters_from_diagnostics(message: Any) -> Iterator[tuple[str, int, int]]:
    """Yields name, message count and byte count of each gateway connection in a ``diagnostic_msgs/DiagnosticArray``."""
    for status in message.status:
        values = {one.key: one.value for one in status.values}
        if {"messages", "bytes"} <= values.keys():
            with contextlib.suppress(ValueError):  # not a number: leave out this connection
                yield status.name, int(values["messages"]), int(values["bytes"])


def speed_from_truth(message: Any) -> tuple[float, float]:
    """Returns forward speed [m/s] and yaw rate [rad/s] from a robot's ``base_pose_ground_truth``.

    Unlike odometry, the p3d plugin gives velocities in the world frame.
    """
    pose, velocity = pose_from_message(message.pose.pose), message.twist.twist
    forwards = math.cos(pose.yaw) * velocity.linear.x + math.sin(pose.yaw) * velocity.linear.y
    return forwards, velocity.angular.z


def status_from_message(message: Any) -> str:
    """Returns the status text of the newest goal in an ``actionlib_msgs/GoalStatusArray``; empty if there is none."""
    return message.status_list[-1].text if message.status_list else ""


def twist_from_goal(goal: Pose) -> Twist:
    """Returns a waypoint in the format of ``map_goal``: position in ``map`` [m], heading in degrees."""
    twist = Twist()
    twist.linear.x, twist.linear.y, twist.angular.z = goal.x, goal.y, math.degrees(goal.yaw)
    return twist
