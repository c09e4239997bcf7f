"""The point cloud that visualises the local planner's cell costs."""

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

_FIELDS = ("x", "y", "z", "path_cost", "goal_cost", "occ_cost", "total_cost")


def cost_cloud(costs: NDArray[np.float64], header: Header) -> PointCloud2:
    """Returns cell costs (``Rollout.cell_costs``) as a cloud with base_local_planner's fields, one point per cell."""
    points = np.insert(costs, 2, 0.0, axis=1).astype("<f4")
    fields = [PointField(name, 4 * number, PointField.FLOAT32, 1) for number, name in enumerate(_FIELDS)]
    step = 4 * len(_FIELDS)
    return PointCloud2(header, 1, len(points), fields, False, step, step * len(points), points.tobytes(), True)
