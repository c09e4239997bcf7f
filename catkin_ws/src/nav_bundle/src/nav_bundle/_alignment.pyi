"""What the compiled kernels/alignment.py offers."""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]

def align(
    start: _Floats,
    points: _Floats,
    field: NDArray[np.uint16],
    placement: _Floats,
    information: _Floats,
    sigma: float,
    iterations: int,
    out: _Floats,
) -> float: ...
