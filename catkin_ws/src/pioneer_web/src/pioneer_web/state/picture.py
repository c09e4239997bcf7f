"""Encodes maps and costmaps as PNG in RViz's colours."""

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image


def _map_colours() -> NDArray[np.uint8]:
    """Returns the palette of RViz's "map" scheme: free is light, occupied dark, unknown greenish."""
    table = np.zeros((256, 4), np.uint8)
    shade = 255 - np.arange(101) * 255 // 100
    table[:101] = np.column_stack([shade, shade, shade, np.full(101, 255)])
    table[101:] = (205, 205, 196, 255)
    return table


def _cost_colours() -> NDArray[np.uint8]:
    """Returns the palette of RViz's "costmap" scheme: blue to red, lethal magenta, inscribed cyan, rest transparent."""
    table = np.zeros((256, 4), np.uint8)
    cost = np.arange(1, 99)
    red = 255 * cost // 100
    table[1:99] = np.column_stack([red, np.zeros_like(red), 255 - red, np.full_like(red, 110)])
    table[99] = (0, 200, 200, 130)
    table[100] = (220, 0, 200, 150)
    return table


MAP, COSTS = _map_colours(), _cost_colours()


def png(cells: NDArray[np.int8], colours: NDArray[np.uint8]) -> bytes:
    """Returns cells as a palette PNG.

    Args:
        cells: [row, col], row 0 at the bottom as in ``nav_msgs/OccupancyGrid``; -1 for unknown.
        colours: RGBA colour of each value, taken as an unsigned byte.
    """
    image = Image.fromarray(np.ascontiguousarray(cells[::-1]).view(np.uint8), "P")
    image.putpalette(colours[:, :3].tobytes())
    file = io.BytesIO()
    image.save(file, "PNG", transparency=colours[:, 3].tobytes(), compress_level=6)
    return file.getvalue()
