"""Conversions of sensor messages to points, and the message class of a costmap's updates."""

import numpy as np
from map_msgs.msg import OccupancyGridUpdate
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan, PointCloud, PointCloud2, PointField

from nav_bundle.base.conversions import CellFields, range_limits
from nav_bundle.base.error import ObservationError
from nav_bundle.base.pose import LARGEST
from nav_bundle.base.scan import points_from_ranges


def points_from_scan(message: LaserScan, inf_is_valid: bool) -> NDArray[np.float64]:
    """Returns the points (n, 3) [m] of a scan message in the laser's frame.

    Raises:
        ObservationError: as for ``scan_from_message``, or no range is a measurement: each is NaN or minus infinity,
            or there are none. Plus infinity is one: nothing is in range.
    """
    limits = range_limits(message)
    ranges = np.asarray(message.ranges, np.float32)
    if not (ranges > -np.inf).any():
        raise ObservationError(f"scan refused: none of its {len(ranges)} ranges is a measurement")
    return points_from_ranges(
        ranges, message.angle_min, message.angle_increment, *limits, inf_is_valid
    )


_REALS = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}


def points_from_cloud(message: PointCloud2) -> NDArray[np.float64]:
    """Returns a cloud's points (n, 3) [m] in its frame, without those that have a coordinate beyond ``LARGEST`` or NaN.

    Raises:
        ObservationError: the cloud has no float fields x, y, z, or fewer bytes than its header declares.
    """
    fields = {field.name: field for field in message.fields}
    order = ">" if message.is_bigendian else "<"
    try:
        formats = [order + _REALS[fields[name].datatype] for name in "xyz"]
    except KeyError:
        raise ObservationError(
            f"a point cloud needs fields x, y, z of floats, this one has {sorted(fields)}"
        ) from None
    offsets = [fields[name].offset for name in "xyz"]
    shape, steps = (message.height, message.width), (message.row_step, message.point_step)
    try:
        kind = np.dtype(
            {
                "names": list("xyz"),
                "formats": formats,
                "offsets": offsets,
                "itemsize": message.point_step,
            }
        )
        records: NDArray[np.void] = np.ndarray(
            shape, kind, bytes(message.data), strides=steps
        ).ravel()
    except (TypeError, ValueError):
        size = f"{len(message.data)} bytes for {message.width} x {message.height} points of {message.point_step}"
        raise ObservationError(f"the point cloud has {size} bytes") from None
    points = np.stack([records[name].astype(np.float64) for name in "xyz"], axis=1)
    return points[(np.abs(points) <= LARGEST).all(axis=1)]


def points_from_old_cloud(message: PointCloud) -> NDArray[np.float64]:
    """Returns a PointCloud's points (n, 3) [m] in its frame, as ``points_from_cloud`` does."""
    points = np.array([(point.x, point.y, point.z) for point in message.points], np.float64)
    points = points.reshape(-1, 3)
    return points[(np.abs(points) <= LARGEST).all(axis=1)]


class GridUpdateMessage(CellFields, OccupancyGridUpdate):  # type: ignore[misc]
    """An OccupancyGridUpdate whose ``data`` may be an int8 array when serialised. For publishers."""
