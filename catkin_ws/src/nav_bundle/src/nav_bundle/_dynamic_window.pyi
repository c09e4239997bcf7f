"""Compiled kernels of kernels/dynamic_window.py; ``core.kernel`` checks array types and layouts, nobody lengths."""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]

def score(
    costs: NDArray[np.uint8],
    origin_x: float,
    origin_y: float,
    resolution: float,
    to_plan: NDArray[np.int32],
    to_goal: NDArray[np.int32],
    to_front: NDArray[np.int32],
    footprint: _Floats,
    pose: _Floats,
    velocity: _Floats,
    acc: _Floats,
    samples: _Floats,
    horizon: _Floats,
    scales: _Floats,
    nose: float,
    accelerating: bool,
    every: bool,
    results: _Floats,
) -> int: ...
def trace(
    pose: _Floats,
    velocity: _Floats,
    acc: _Floats,
    sample: _Floats,
    horizon: _Floats,
    accelerating: bool,
    poses: _Floats,
) -> int: ...
