"""Conversions between messages and core values, and message classes with numpy arrays.

Every ``…_from_message`` checks its input: a number that is not finite or exceeds ``LARGEST`` raises a
``MessageError`` that names the field. This is the boundary at which the kernels' assumptions are checked: code that
uses the converted values does not have to check again.

genpy turns an ``int8[]`` into a tuple of ints, which takes seconds and hundreds of megabytes for a map of
4000 x 4000 cells. The classes here have the same wire format, type and MD5 sum. Pass them to a Subscriber, a
ServiceProxy or a Service in place of the generated ones.
"""

import io
import math
import struct
from collections.abc import Iterator
from typing import Any, Self

import genpy
import numpy as np
from geometry_msgs.msg import Point, PoseArray, PoseStamped, PoseWithCovarianceStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMessage
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import MapMetaData, OccupancyGrid, Odometry, Path
from nav_msgs.srv import (
    GetMap,
    GetMapResponse,
    GetPlan,
    GetPlanResponse,
    LoadMap,
    LoadMapResponse,
    SetMap,
    SetMapRequest,
)
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from std_msgs.msg import Header

from nav_bundle.core.error import MapError, MessageError, ObservationError
from nav_bundle.core.grid import Grid
from nav_bundle.core.local_planner import Velocity
from nav_bundle.core.pose import LARGEST, Pose
from nav_bundle.core.sensor import LONGEST, Scan, points_from_ranges
from nav_bundle.core.transform import Transform
from pioneer_node.core.frame import stripped


def _write_at_end(buff: io.BytesIO, items: NDArray[Any]) -> None:
    """Writes an array's items in place of the empty array that ends a serialised message."""
    buff.seek(-4, io.SEEK_CUR)
    buff.write(struct.pack("<I", len(items)))
    buff.write(np.ascontiguousarray(items).data)


def _pose_fields(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the seven numbers of each pose (x, y [m], yaw [rad]; shape (n, 3)) at z = 0, shape (n, 7)."""
    fields = np.zeros((len(poses), 7))
    fields[:, :2] = poses[:, :2]
    fields[:, 5] = np.sin(poses[:, 2] / 2.0)
    fields[:, 6] = np.cos(poses[:, 2] / 2.0)
    return fields


class _Arrays(genpy.Message):  # type: ignore[misc]
    """Mixin for a message whose sequences of numbers are deserialised as arrays."""

    def deserialize(self, data: bytes) -> Self:
        """Reads the message from ``data``."""
        return self.deserialize_numpy(data, np)


class _Cells(genpy.Message):  # type: ignore[misc]
    """Mixin for a message whose last field is int8 ``data``; lets ``data`` be an array when serialised."""

    data: Any

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the message; ``data`` may be any sequence of int8."""
        cells = np.asarray(self.data, np.int8)
        self.data, kept = (), self.data
        try:
            super().serialize(buff)
        finally:
            self.data = kept
        _write_at_end(buff, cells.ravel())


class GridMessage(_Arrays, _Cells, OccupancyGrid):  # type: ignore[misc]
    """An OccupancyGrid whose ``data`` is deserialised as an int8 array, and may be one when serialised."""


class ScanMessage(_Arrays, LaserScan):  # type: ignore[misc]
    """A LaserScan whose ``ranges`` and ``intensities`` are deserialised as float32 arrays. For subscribers."""


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


class SetMapArrayRequest(_Arrays, SetMapRequest):  # type: ignore[misc]
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


class ParticlesMessage(PoseArray):  # type: ignore[misc]
    """A PoseArray serialised from a numpy array. For publishers."""

    def __init__(self, particles: NDArray[np.float64], frame: str, stamp: Any) -> None:
        super().__init__(Header(0, stamp, stripped(frame)), [])
        self.particles = particles  #: x, y [m], yaw [rad], shape (n, 3)

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the particles as poses at z = 0."""
        super().serialize(buff)
        _write_at_end(buff, _pose_fields(self.particles))


LARGEST_SPEED = 100.0
"""Largest magnitude accepted for a measured speed [m/s], [rad/s]."""
FINEST = 1.0e-3
"""Smallest resolution accepted for a map [m]."""


def check_numbers(what: str, message: genpy.Message, largest: float = LARGEST) -> None:
    """Raises if a number in the message, nested fields included, is not finite or exceeds ``largest``.

    Raises:
        MessageError: names ``what``, the field and its value.
    """
    for name, value in _numbers(message):
        if not abs(value) <= largest:
            raise MessageError(
                f"{what} refused: {name} must be a number within ±{largest:g}, not {value}"
            )


def _numbers(message: genpy.Message, prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yields each float of a message, nested fields and array elements included, with its path."""
    for slot in message.__slots__:
        value = getattr(message, slot)
        if isinstance(value, float):
            yield f"{prefix}{slot}", value
        elif isinstance(value, genpy.Message):
            yield from _numbers(value, f"{prefix}{slot}.")
        elif isinstance(value, (tuple, list)):
            yield from ((f"{prefix}{slot}[{index}]", each) for index, each in enumerate(value))


def yaw_from_quaternion(quaternion: Quaternion) -> float:
    """Returns the yaw [rad] in [-pi, pi] of a rotation; the quaternion need not be normalised."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def quaternion_from_yaw(yaw: float) -> Quaternion:
    """Returns the rotation about z by ``yaw`` [rad]."""
    return Quaternion(0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0))


def pose_from_message(message: PoseMessage) -> Pose:
    """Returns the planar part of a geometry_msgs/Pose: z, roll and pitch are dropped.

    Raises:
        MessageError: a number is not finite, or exceeds ``LARGEST``.
    """
    check_numbers("pose", message)
    return Pose(message.position.x, message.position.y, yaw_from_quaternion(message.orientation))


def message_from_pose(pose: Pose) -> PoseMessage:
    """Returns ``pose`` as a geometry_msgs/Pose at z = 0."""
    return PoseMessage(Point(pose.x, pose.y, 0.0), quaternion_from_yaw(pose.yaw))


def stamped_from_pose(pose: Pose, frame: str, stamp: Any) -> PoseStamped:
    """Returns ``pose``, given in ``frame`` at time ``stamp`` (genpy.Time), as a PoseStamped."""
    return PoseStamped(Header(0, stamp, stripped(frame)), message_from_pose(pose))


def covariance_from_message(message: PoseWithCovarianceStamped) -> NDArray[np.float64]:
    """Returns the covariance over x [m], y [m], yaw [rad], shape (3, 3), of a pose with covariance.

    Raises:
        MessageError: a number is not finite, or exceeds ``LARGEST`` squared.
    """
    check_numbers("initial pose", message.pose, LARGEST**2)
    full = np.array(message.pose.covariance).reshape(6, 6)
    return full[np.ix_([0, 1, 5], [0, 1, 5])]


def covariance_message(covariance: NDArray[np.float64]) -> list[float]:
    """Returns a 6 x 6 covariance in row-major order from a covariance over x, y, yaw."""
    full = np.zeros((6, 6))
    full[np.ix_([0, 1, 5], [0, 1, 5])] = covariance
    return full.ravel().tolist()


def scan_from_message(message: LaserScan, base_from_laser: Transform) -> Scan:
    """Returns the scan of a LaserScan or ScanMessage in the robot's frame; reverses the angles of an inverted laser.

    Raises:
        ObservationError: an angle is not finite, a range limit is NaN, or ``range_max`` is not positive.
    """
    shortest, longest = _checked_limits(message)
    side = 1.0 if base_from_laser.upright() else -1.0
    return Scan(
        np.asarray(message.ranges, np.float32),
        side * message.angle_min,
        side * message.angle_increment,
        shortest,
        longest,
        base_from_laser.planar(),
    )


def points_from_scan(message: LaserScan, inf_is_valid: bool) -> NDArray[np.float64]:
    """Returns the points (n, 3) [m] of a scan message in the laser's frame.

    Raises:
        ObservationError: as for ``scan_from_message``, or no range is a measurement: each is NaN or minus infinity,
            or there are none. Plus infinity is one: nothing is in range.
    """
    limits = _checked_limits(message)
    ranges = np.asarray(message.ranges, np.float32)
    if not (ranges > -np.inf).any():
        raise ObservationError(f"scan refused: none of its {len(ranges)} ranges is a measurement")
    return points_from_ranges(
        ranges, message.angle_min, message.angle_increment, *limits, inf_is_valid
    )


def _checked_limits(message: LaserScan) -> tuple[float, float]:
    """Returns the scan's ``range_min``, at least 0, and its ``range_max``, at most ``LONGEST``: that means no limit.

    NaN and infinity are valid ranges: they mean no return.

    Raises:
        ObservationError: an angle or range limit is invalid.
    """
    numbers = (message.angle_min, message.angle_increment, message.range_min, message.range_max)
    if not all(map(math.isfinite, numbers[:2])) or any(map(math.isnan, numbers)):
        names = "angle_min, angle_increment, range_min, range_max"
        raise ObservationError(
            f"scan refused: {names} must be finite numbers, not {', '.join(map(str, numbers))}"
        )
    if message.range_max <= 0.0:
        raise ObservationError(f"scan refused: range_max must be positive, not {message.range_max}")
    return max(message.range_min, 0.0), min(message.range_max, LONGEST)


def velocity_from_odometry(message: Odometry) -> Velocity:
    """Returns the robot's velocity in the robot's frame.

    Raises:
        MessageError: a number is not finite, or exceeds ``LARGEST_SPEED``.
    """
    twist = message.twist.twist
    check_numbers("odometry", twist, LARGEST_SPEED)
    return Velocity(twist.linear.x, twist.linear.y, twist.angular.z)


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


_COSTS = ("x", "y", "z", "path_cost", "goal_cost", "occ_cost", "total_cost")


def cost_cloud(costs: NDArray[np.float64], header: Header) -> PointCloud2:
    """Returns cell costs (``Rollout.cell_costs``) as a cloud with base_local_planner's fields, one point per cell."""
    points = np.insert(costs, 2, 0.0, axis=1).astype("<f4")
    fields = [
        PointField(name, 4 * number, PointField.FLOAT32, 1) for number, name in enumerate(_COSTS)
    ]
    step = 4 * len(_COSTS)
    return PointCloud2(
        header, 1, len(points), fields, False, step, step * len(points), points.tobytes(), True
    )


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


class GridUpdateMessage(_Cells, OccupancyGridUpdate):  # type: ignore[misc]
    """An OccupancyGridUpdate whose ``data`` may be an int8 array when serialised. For publishers."""


class PathMessage(Path):  # type: ignore[misc]
    """A Path serialised from an array, because creating hundreds of PoseStamped objects takes milliseconds."""

    def __init__(self, track: NDArray[np.float64], frame: str, stamp: Any) -> None:
        super().__init__(Header(0, stamp, stripped(frame)), [])
        self.track = track  #: poses (x, y [m], yaw [rad]), shape (n, 3), in the header's frame and at its stamp

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the header and the track's poses."""
        super().serialize(buff)
        frame = self.header.frame_id.encode()
        head = [("seq", "<u4"), ("secs", "<u4"), ("nsecs", "<u4"), ("length", "<u4")]
        records = np.zeros(
            len(self.track), np.dtype([*head, ("frame", f"V{len(frame)}"), ("pose", "<f8", 7)])
        )
        records["secs"], records["nsecs"] = self.header.stamp.secs, self.header.stamp.nsecs
        records["length"], records["frame"] = len(frame), np.void(frame)
        records["pose"] = _pose_fields(self.track)
        _write_at_end(buff, records)


class GetPlanArrayResponse(GetPlanResponse):  # type: ignore[misc]
    """A GetPlan response that holds a ``PathMessage``. For services."""

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the response: only the plan."""
        self.plan.serialize(buff)


class GetPlanArray(GetPlan):  # type: ignore[misc]
    """nav_msgs/GetPlan whose response is serialised from an array."""

    _response_class = GetPlanArrayResponse
