"""Conversions of the measured velocity, and of the local planners' cell costs."""

import numpy as np
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from nav_bundle.base.conversions import check_numbers
from nav_bundle.base.velocity import Velocity

LARGEST_SPEED = 100.0
"""Largest magnitude accepted for a measured speed [m/s], [rad/s]."""


def velocity_from_odometry(message: Odometry) -> Velocity:
    """Returns the robot's velocity in the robot's frame.

    Raises:
        MessageError: a number is not finite, or exceeds ``LARGEST_SPEED``.
    """
    twist = message.twist.twist
    check_numbers("odometry", twist, LARGEST_SPEED)
    return Velocity(twist.linear.x, twist.linear.y, twist.angular.z)


_COSTS = ("x", "y", "z", "path_cost", "goal_cost", "occ_cost", "total_cost")


def cost_cloud(costs: NDArray[np.float64], header: Header) -> PointCloud2:
    """Returns cell costs (``Rollout.cell_costs``) as a cloud with base_local_planner's fields, one point per cell."""
    points = np.insert(costs, 2, 0.0, axis=1).astype("<f4")
    fields = [
        PointField(name, 4 * number, PointField.FLOAT32, 1) for number, name in enumerate(_COSTS)
    ]
    step = 4 * len(_COSTS)
    return PointCloud2(
        header, 1, len(points), fields, False, step, step * len(points), points.tobytes(), True
    )
