"""Compiled kernels of kernels/navfn.py; ``core.kernel`` checks array types and layouts, nobody lengths."""

import numpy as np
from numpy.typing import NDArray

def begin(
    potential: NDArray[np.float32],
    waiting: NDArray[np.uint8],
    costs: NDArray[np.uint8],
    weights: NDArray[np.float32],
    queue: NDArray[np.int32],
    counts: NDArray[np.int64],
    limits: NDArray[np.float64],
    row: int,
    col: int,
) -> None: ...
def spread(
    potential: NDArray[np.float32],
    waiting: NDArray[np.uint8],
    costs: NDArray[np.uint8],
    weights: NDArray[np.float32],
    queue: NDArray[np.int32],
    counts: NDArray[np.int64],
    limits: NDArray[np.float64],
    goal_row: int,
    goal_col: int,
    guide: NDArray[np.float32],
    budget: int,
) -> int: ...
def coarsen(costs: NDArray[np.uint8], weights: NDArray[np.float32], coarse: NDArray[np.uint8]) -> None: ...
def descend(
    potential: NDArray[np.float32],
    path: NDArray[np.float64],
    row: int,
    col: int,
    source_row: int,
    source_col: int,
) -> int: ...
def nearest_reached(
    potential: NDArray[np.float32],
    row: int,
    col: int,
    tolerance: float,
) -> int: ...
