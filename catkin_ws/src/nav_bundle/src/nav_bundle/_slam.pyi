"""What the compiled kernels/slam.py offers."""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]
_Tiles = NDArray[np.uint16]
_Numbers = NDArray[np.int32]

def match(
    poses: _Floats,
    beams: _Floats,
    directories: _Numbers,
    pool: _Tiles,
    placement: _Floats,
    terms: _Floats,
    iterations: int,
    reach: int,
    out: _Floats,
) -> None: ...
def register(
    pose: _Floats,
    beams: _Floats,
    hits: NDArray[np.uint8],
    placement: _Floats,
    directory: _Numbers,
    pool: _Tiles,
    users: _Numbers,
    spare: _Numbers,
) -> None: ...
def draw(
    directory: _Numbers,
    pool: _Tiles,
    threshold: float,
    first_row: int,
    first_col: int,
    out: NDArray[np.int8],
) -> None: ...
