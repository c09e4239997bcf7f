"""Compiled kernels of kernels/plan_distance.py; ``core.kernel`` checks array types and layouts, nobody lengths."""

import numpy as np
from numpy.typing import NDArray

def distance_grids(
    costs: NDArray[np.uint8],
    origin_x: float,
    origin_y: float,
    resolution: float,
    plan: NDArray[np.float64],
    outline: NDArray[np.float64],
    to_plan: NDArray[np.int32],
    to_goal: NDArray[np.int32],
    queue: NDArray[np.int32],
) -> int: ...
def goal_grid(
    costs: NDArray[np.uint8],
    origin_x: float,
    origin_y: float,
    resolution: float,
    plan: NDArray[np.float64],
    outline: NDArray[np.float64],
    to_goal: NDArray[np.int32],
    queue: NDArray[np.int32],
) -> int: ...
