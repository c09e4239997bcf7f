from numpy import float64, int32
from numpy.typing import NDArray

def count_items(
    segments: NDArray[float64],
    circles: NDArray[float64],
    x0: float,
    y0: float,
    cell: float,
    rows: int,
    cols: int,
    counts: NDArray[int32],
) -> None: ...
def fill_items(
    segments: NDArray[float64],
    circles: NDArray[float64],
    x0: float,
    y0: float,
    cell: float,
    rows: int,
    cols: int,
    cursors: NDArray[int32],
    items: NDArray[int32],
) -> None: ...
def cast(
    segments: NDArray[float64],
    circles: NDArray[float64],
    starts: NDArray[int32],
    items: NDArray[int32],
    x0: float,
    y0: float,
    cell: float,
    rows: int,
    cols: int,
    px: float,
    py: float,
    yaw: float,
    first: float,
    increment: float,
    max_range: float,
    out: NDArray[float64],
) -> None: ...
def cast_movers(
    segments: NDArray[float64],
    starts: NDArray[int32],
    poses: NDArray[float64],
    radii: NDArray[float64],
    own: int,
    px: float,
    py: float,
    yaw: float,
    first: float,
    increment: float,
    max_range: float,
    out: NDArray[float64],
) -> None: ...
def measure(
    out: NDArray[float64],
    noise: NDArray[float64],
    mean: float,
    deviation: float,
    resolution: float,
    least: float,
    most: float,
) -> None: ...
