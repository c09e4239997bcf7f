"""Compiled kernels of kernels/costmap.py; ``core.kernel`` checks array types and layouts, nobody lengths."""

import numpy as np
from numpy.typing import NDArray

def clear_rays(
    cells: NDArray[np.uint8],
    origin_x: float,
    origin_y: float,
    resolution: float,
    sensor_x: float,
    sensor_y: float,
    points: NDArray[np.float64],
    longest: float,
) -> None: ...
def mark_points(
    cells: NDArray[np.uint8],
    origin_x: float,
    origin_y: float,
    resolution: float,
    sensor_x: float,
    sensor_y: float,
    points: NDArray[np.float64],
    longest: float,
) -> None: ...
def fill_polygon(
    cells: NDArray[np.uint8],
    origin_x: float,
    origin_y: float,
    resolution: float,
    vertices: NDArray[np.float64],
    value: int,
) -> None: ...
def merge_highest(
    master: NDArray[np.uint8],
    layer: NDArray[np.uint8],
    row_0: int,
    row_1: int,
    col_0: int,
    col_1: int,
) -> None: ...
def merge_known(
    master: NDArray[np.uint8],
    layer: NDArray[np.uint8],
    row_0: int,
    row_1: int,
    col_0: int,
    col_1: int,
) -> None: ...
def changed_window(
    cells: NDArray[np.uint8],
    before: NDArray[np.uint8],
    row_0: int,
    col_0: int,
    window: NDArray[np.int64],
) -> None: ...
def inflate(
    cells: NDArray[np.uint8],
    row_0: int,
    row_1: int,
    col_0: int,
    col_1: int,
    radius: int,
    table: NDArray[np.uint8],
    inflate_unknown: bool,
) -> None: ...
