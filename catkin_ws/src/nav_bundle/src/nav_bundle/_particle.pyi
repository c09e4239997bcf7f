"""What the compiled kernels/particle.py offers."""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]

def resample(
    poses: _Floats,
    cumulative: _Floats,
    uniforms: _Floats,
    renew: NDArray[np.uint8],
    fresh: _Floats,
    least: int,
    error: float,
    quantile: float,
    table: NDArray[np.int64],
    out: _Floats,
) -> int: ...
def find_cells(
    cells: NDArray[np.int8],
    value: int,
    until_row: NDArray[np.int64],
    drawn: NDArray[np.int64],
    out: NDArray[np.int64],
) -> None: ...
def cluster(
    poses: _Floats, weights: _Floats, table: NDArray[np.int64], labels: NDArray[np.int64], sums: _Floats
) -> int: ...
