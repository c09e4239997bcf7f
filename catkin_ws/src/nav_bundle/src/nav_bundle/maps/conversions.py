"""Conversions between map messages and grids, and message classes with numpy arrays.

genpy turns an ``int8[]`` into a tuple of ints, which takes seconds and hundreds of megabytes for a map of
4000 x 4000 cells. The classes here have the same wire format, type and MD5 sum. Pass them to a Subscriber, a
ServiceProxy or a Service in place of the generated ones.
"""

import io
import struct
from typing import Any, Self

import numpy as np
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import (
    GetMap,
    GetMapResponse,
    LoadMap,
    LoadMapResponse,
    SetMap,
    SetMapRequest,
)
from std_msgs.msg import Header

from nav_bundle.base.conversions import (
    ArrayFields,
    CellFields,
    check_numbers,
    message_from_pose,
    pose_from_message,
)
from nav_bundle.base.error import MapError
from nav_bundle.maps.grid import Grid
from pioneer_node.core.frame import stripped


class GridMessage(ArrayFields, CellFields, OccupancyGrid):  # type: ignore[misc]
    """An OccupancyGrid whose ``data`` is deserialised as an int8 array, and may be one when serialised."""


class GetMapArrayResponse(GetMapResponse):  # type: ignore[misc]
    """A GetMap response that holds a ``GridMessage``."""

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the response: only the map."""
        self.map.serialize(buff)

    def deserialize(self, data: bytes) -> Self:
        """Reads the response from ``data``."""
        self.map = GridMessage().deserialize(data)
        return self


class GetMapArray(GetMap):  # type: ignore[misc]
    """nav_msgs/GetMap with array cells."""

    _response_class = GetMapArrayResponse


class SetMapArrayRequest(ArrayFields, SetMapRequest):  # type: ignore[misc]
    """A SetMap request whose map ``data`` is deserialised as an int8 array."""


class SetMapArray(SetMap):  # type: ignore[misc]
    """nav_msgs/SetMap with array cells."""

    _request_class = SetMapArrayRequest


class LoadMapArrayResponse(LoadMapResponse):  # type: ignore[misc]
    """A LoadMap response that holds a ``GridMessage``. For services."""

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the response: the map and the result."""
        self.map.serialize(buff)
        buff.write(struct.pack("<B", self.result))


class LoadMapArray(LoadMap):  # type: ignore[misc]
    """nav_msgs/LoadMap with array cells."""

    _response_class = LoadMapArrayResponse


FINEST = 1.0e-3
"""Smallest resolution accepted for a map [m]."""


def grid_from_message(message: OccupancyGrid) -> Grid:
    """Returns the map of an OccupancyGrid or GridMessage; an array ``data`` is shared, and the cells are read-only.

    Raises:
        MapError: no cells, a number of cells other than width x height, or a resolution below ``FINEST``.
        MessageError: origin or resolution is not finite, or exceeds ``LARGEST``.
    """
    info = message.info
    check_numbers("map", info)
    if info.width * info.height != len(message.data):
        raise MapError(
            f"the map has {len(message.data)} cells, expected {info.width} x {info.height}"
        )
    if not info.resolution >= FINEST:
        raise MapError(f"a map's resolution must be at least {FINEST:g} m, not {info.resolution}")
    cells = np.asarray(message.data, np.int8).reshape(info.height, info.width)
    return Grid(float_from_float32(info.resolution), pose_from_message(info.origin), cells)


def updated_grid(grid: Grid, update: OccupancyGridUpdate) -> Grid:
    """Returns ``grid`` with the part that ``update`` holds.

    Raises:
        MapError: the part is not inside the map, or has a number of cells other than width x height.
    """
    rows = slice(update.y, update.y + update.height)
    cols = slice(update.x, update.x + update.width)
    if min(update.x, update.y) < 0 or rows.stop > grid.rows or cols.stop > grid.cols:
        raise MapError(
            f"a part of {update.width} x {update.height} cells at ({update.x}, {update.y}) is not inside the map of "
            f"{grid.cols} x {grid.rows}"
        )
    if update.width * update.height != len(update.data):
        raise MapError(
            f"a part of the map has {len(update.data)} cells, expected {update.width} x {update.height}"
        )
    cells = grid.cells.copy()
    cells[rows, cols] = np.asarray(update.data, np.int8).reshape(update.height, update.width)
    return Grid(grid.resolution, grid.origin, cells)


def float_from_float32(value: float) -> float:
    """Returns the shortest decimal that rounds to the same float32: 0.05, not 0.0500000007."""
    return float(str(np.float32(value)))


def message_from_grid(
    grid: Grid, frame: str, stamp: Any, load_time: Any | None = None
) -> GridMessage:
    """Returns ``grid`` as a GridMessage in ``frame``; the message shares the cells' memory.

    Args:
        grid: the map.
        frame: frame of its origin; a leading slash is dropped.
        stamp: genpy.Time of the header.
        load_time: genpy.Time at which the map was made or loaded; defaults to ``stamp``.
    """
    info = MapMetaData(
        load_time or stamp, grid.resolution, grid.cols, grid.rows, message_from_pose(grid.origin)
    )
    return GridMessage(Header(0, stamp, stripped(frame)), info, grid.cells.reshape(-1))
