"""Compiled kernels of kernels/trajectory.py; ``core.kernel`` checks array types and layouts, nobody lengths."""

import numpy as np
from numpy.typing import NDArray

def footprint_cost(
    costs: NDArray[np.uint8],
    origin_x: float,
    origin_y: float,
    resolution: float,
    footprint: NDArray[np.float64],
    x: float,
    y: float,
    yaw: float,
) -> int: ...
def search(
    costs: NDArray[np.uint8],
    origin_x: float,
    origin_y: float,
    resolution: float,
    to_plan: NDArray[np.int32],
    to_goal: NDArray[np.int32],
    footprint: NDArray[np.float64],
    pose: NDArray[np.float64],
    velocity: NDArray[np.float64],
    acc: NDArray[np.float64],
    samples: NDArray[np.float64],
    horizon: NDArray[np.float64],
    scales: NDArray[np.float64],
    reach: bool,
    every: bool,
    plan: NDArray[np.float64],
    heading_time: float,
    results: NDArray[np.float64],
) -> int: ...
def roll_out(
    pose: NDArray[np.float64],
    velocity: NDArray[np.float64],
    acc: NDArray[np.float64],
    sample: NDArray[np.float64],
    horizon: NDArray[np.float64],
    poses: NDArray[np.float64],
) -> int: ...
