"""What the compiled kernels/likelihood.py offers."""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]

def distance_field(cells: NDArray[np.int8], occupied: int, cap: int, out: NDArray[np.uint16]) -> None: ...
def add_likelihoods(
    poses: _Floats, points: _Floats, field: NDArray[np.uint16], placement: _Floats, table: _Floats, out: _Floats
) -> None: ...
def count_agreement(
    poses: _Floats,
    points: _Floats,
    field: NDArray[np.uint16],
    placement: _Floats,
    nearest: int,
    counts: NDArray[np.int64],
) -> None: ...
def expected_ranges(
    poses: _Floats,
    laser: _Floats,
    bearings: _Floats,
    cells: NDArray[np.int8],
    placement: _Floats,
    longest: float,
    out: _Floats,
) -> None: ...
