"""Writes maps in map_server's format: NAME.yaml beside NAME.pgm."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.core.raster import Extent

_YAML = """\
image: {image}
resolution: {resolution:.6g}
origin: [{x:.6g}, {y:.6g}, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def write_map(path: Path, grey: NDArray[np.uint8], extent: Extent) -> None:
    """Writes ``path`` with the suffixes .yaml and .pgm.

    Args:
        path: with or without a suffix; its directory is created.
        grey: shape (rows, cols), row 0 at the smallest y: 0 occupied, 254 free, 205 unknown.
        extent: position and resolution of the grid.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    image = path.with_suffix(".pgm")
    rows, cols = grey.shape
    image.write_bytes(b"P5\n%d %d\n255\n" % (cols, rows) + np.ascontiguousarray(grey[::-1]).tobytes())
    text = _YAML.format(image=image.name, resolution=extent.resolution, x=extent.x, y=extent.y)
    path.with_suffix(".yaml").write_text(text)
