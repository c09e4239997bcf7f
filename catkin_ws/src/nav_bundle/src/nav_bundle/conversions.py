"""Messages from and to core values, and message classes whose long arrays are numpy's.

Every ``…_from_message`` checks what it converts: a number that is not finite or beyond ``LARGEST`` raises a
``MessageError`` that names the field. Nothing behind this module has to check again.

genpy turns an ``int8[]`` into a tuple of ints, which takes seconds and hundreds of megabytes for a map of
4000 x 4000 cells. The classes here read and write the same bytes under the same type and MD5 sum: give them
to a Subscriber, a ServiceProxy or a Service in place of the generated ones.
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

from nav_bundle.core.costmap.scan import points_from_ranges
from nav_bundle.core.error import MapError, MessageError, ObservationError
from nav_bundle.core.grid import Grid
from nav_bundle.core.local_planner import Velocity
from nav_bundle.core.pose import Pose
from nav_bundle.core.sensor import Scan
from nav_bundle.core.transform import Transform
from pioneer_node.core.frame import stripped


class _Cells(genpy.Message):  # type: ignore[misc]
    """Mixed into a message that ends in int8 ``data``, which may then be an array when it is written."""

    data: Any

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the message; ``data`` may be any sequence of int8."""
        cells = np.asarray(self.data, np.int8)
        self.data, kept = (), self.data
        try:
            super().serialize(buff)
        finally:
            self.data = kept
        buff.seek(-4, io.SEEK_CUR)
        buff.write(struct.pack("<I", cells.size))
        buff.write(np.ascontiguousarray(cells).data)


class GridMessage(_Cells, OccupancyGrid):  # type: ignore[misc]
    """An OccupancyGrid whose ``data`` is read as an int8 array, and may be one when it is written."""

    def deserialize(self, data: bytes) -> Self:
        """Reads the message from ``data``."""
        return self.deserialize_numpy(data, np)


class ScanMessage(LaserScan):  # type: ignore[misc]
    """A LaserScan whose ``ranges`` and ``intensities`` are read as float32 arrays. For subscribers."""

    def deserialize(self, data: bytes) -> Self:
        """Reads the message from ``data``."""
        return self.deserialize_numpy(data, np)


class GetMapArrayResponse(GetMapResponse):  # type: ignore[misc]
    """A GetMap response around a ``GridMessage``."""

    def __init__(self, *args: Any, **fields: Any) -> None:
        super().__init__(*args, **fields)
        if not args and not fields:
            self.map = GridMessage()

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the response: the map's bytes and nothing else."""
        self.map.serialize(buff)

    def deserialize(self, data: bytes) -> Self:
        """Reads the response from ``data``."""
        self.map.deserialize(data)
        return self


class GetMapArray(GetMap):  # type: ignore[misc]
    """nav_msgs/GetMap with array cells."""

    _response_class = GetMapArrayResponse


class SetMapArrayRequest(SetMapRequest):  # type: ignore[misc]
    """A SetMap request whose map's ``data`` is read as an int8 array."""

    def deserialize(self, data: bytes) -> Self:
        """Reads the request from ``data``."""
        return self.deserialize_numpy(data, np)


class SetMapArray(SetMap):  # type: ignore[misc]
    """nav_msgs/SetMap with array cells."""

    _request_class = SetMapArrayRequest


class LoadMapArrayResponse(LoadMapResponse):  # type: ignore[misc]
    """A LoadMap response around a ``GridMessage``. For services."""

    def __init__(self, *args: Any, **fields: Any) -> None:
        super().__init__(*args, **fields)
        if not args and "map" not in fields:
            self.map = GridMessage()

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the response: the map's bytes and the result."""
        self.map.serialize(buff)
        buff.write(struct.pack("<B", self.result))


class LoadMapArray(LoadMap):  # type: ignore[misc]
    """nav_msgs/LoadMap with array cells."""

    _response_class = LoadMapArrayResponse


class ParticlesMessage(PoseArray):  # type: ignore[misc]
    """A PoseArray written from an array. For publishers."""

    def __init__(self, particles: NDArray[np.float64], frame: str, stamp: Any) -> None:
        super().__init__(Header(0, stamp, stripped(frame)), [])
        self.particles = particles  #: x, y [m], yaw [rad], shape (n, 3)

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the particles as poses at z = 0."""
        super().serialize(buff)
        poses = np.zeros((len(self.particles), 7))
        poses[:, :2] = self.particles[:, :2]
        poses[:, 5] = np.sin(self.particles[:, 2] / 2.0)
        poses[:, 6] = np.cos(self.particles[:, 2] / 2.0)
        buff.seek(-4, io.SEEK_CUR)
        buff.write(struct.pack("<I", len(poses)))
        buff.write(poses.tobytes())


LARGEST = 1.0e6
"""Largest magnitude of a number that a message may bring: farther off [m] or faster [m/s] nothing is."""


def check_numbers(what: str, message: genpy.Message, largest: float = LARGEST) -> None:
    """Refuses a message that holds a number which is not finite or larger than ``largest``, nested fields included.

    Raises:
        MessageError: names ``what``, the field and its value.
    """
    for name, value in _numbers(message):
        if not abs(value) <= largest:
            raise MessageError(f"{what} refused: {name} must be a number within ±{largest:g}, not {value}")


def _numbers(message: genpy.Message, prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yields each float of a message, however deep, with its path; arrays element by element."""
    for slot in message.__slots__:
        value = getattr(message, slot)
        if isinstance(value, float):
            yield f"{prefix}{slot}", value
        elif isinstance(value, genpy.Message):
            yield from _numbers(value, f"{prefix}{slot}.")
        elif isinstance(value, (tuple, list)):
            yield from ((f"{prefix}{slot}[{index}]", each) for index, each in enumerate(value))


def yaw_from_quaternion(quaternion: Quaternion) -> float:
    """Returns the heading [rad], in [-pi, pi], of a rotation; the quaternion's length does not matter."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def quaternion_from_yaw(yaw: float) -> Quaternion:
    """Returns the rotation about z by ``yaw`` [rad]."""
    return Quaternion(0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0))


def pose_from_message(message: PoseMessage) -> Pose:
    """Returns the planar part of a geometry_msgs/Pose: z, roll and pitch are dropped.

    Raises:
        MessageError: a number is not finite, or beyond ``LARGEST``.
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
        MessageError: a number is not finite, or beyond ``LARGEST`` squared.
    """
    check_numbers("initial pose", message.pose, LARGEST**2)
    full = np.array(message.pose.covariance).reshape(6, 6)
    return full[np.ix_([0, 1, 5], [0, 1, 5])]


def covariance_message(covariance: NDArray[np.float64]) -> list[float]:
    """Returns a 6 x 6 covariance, row by row, from one over x, y, yaw."""
    full = np.zeros((6, 6))
    full[np.ix_([0, 1, 5], [0, 1, 5])] = covariance
    return full.ravel().tolist()


def scan_from_message(message: LaserScan, base_from_laser: Transform) -> Scan:
    """Returns the scan of a (Scan)Message as seen from the robot; a laser mounted upside down turns the other way.

    Raises:
        ObservationError: an angle is not finite, or a range limit is NaN.
    """
    _check_scan(message)
    side = 1.0 if base_from_laser.upright() else -1.0
    return Scan(
        np.asarray(message.ranges, np.float32),
        side * message.angle_min,
        side * message.angle_increment,
        message.range_min,
        message.range_max,
        base_from_laser.planar(),
    )


def points_from_scan(message: LaserScan, inf_is_valid: bool) -> NDArray[np.float64]:
    """Returns the points (n, 3) [m] of a (Scan)Message in the laser's frame; raises as ``scan_from_message`` does."""
    _check_scan(message)
    ranges, limits = np.asarray(message.ranges, np.float32), (message.range_min, message.range_max)
    return points_from_ranges(ranges, message.angle_min, message.angle_increment, *limits, inf_is_valid)


def _check_scan(message: LaserScan) -> None:
    """Refuses angles that are none. Ranges need no check: NaN and infinity among them mean that nothing was seen."""
    numbers = (message.angle_min, message.angle_increment, message.range_min, message.range_max)
    if not all(map(math.isfinite, numbers[:2])) or any(map(math.isnan, numbers)):
        names = "angle_min, angle_increment, range_min, range_max"
        raise ObservationError(f"scan refused: {names} must be finite numbers, not {', '.join(map(str, numbers))}")


def velocity_from_odometry(message: Odometry) -> Velocity:
    """Returns the robot's velocity in its own frame.

    Raises:
        MessageError: a number is not finite, or beyond ``LARGEST``.
    """
    twist = message.twist.twist
    check_numbers("odometry", twist)
    return Velocity(twist.linear.x, twist.linear.y, twist.angular.z)


_REALS = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}


def points_from_cloud(message: PointCloud2) -> NDArray[np.float64]:
    """Returns a cloud's points (n, 3) [m] in its frame, without those that have a coordinate that is no number.

    Raises:
        ObservationError: the cloud has no fields x, y, z of floats, or fewer bytes than it says.
    """
    fields = {field.name: field for field in message.fields}
    order = ">" if message.is_bigendian else "<"
    try:
        formats = [order + _REALS[fields[name].datatype] for name in "xyz"]
    except KeyError:
        raise ObservationError(f"a point cloud needs fields x, y, z of floats, this one has {sorted(fields)}") from None
    offsets = [fields[name].offset for name in "xyz"]
    shape, steps = (message.height, message.width), (message.row_step, message.point_step)
    try:
        kind = np.dtype({"names": list("xyz"), "formats": formats, "offsets": offsets, "itemsize": message.point_step})
        records: NDArray[np.void] = np.ndarray(shape, kind, bytes(message.data), strides=steps).ravel()
    except (TypeError, ValueError):
        size = f"{len(message.data)} bytes for {message.width} x {message.height} points of {message.point_step}"
        raise ObservationError(f"a point cloud came with {size} bytes") from None
    points = np.stack([records[name].astype(np.float64) for name in "xyz"], axis=1)
    return points[np.isfinite(points).all(axis=1)]


def grid_from_message(message: OccupancyGrid) -> Grid:
    """Returns the map of a (Grid)Message; the cells share its memory where it is an array, and are then read-only.

    Raises:
        MapError: no cells, another number of them than width and height say, or no resolution.
        MessageError: origin or resolution are not finite, or beyond ``LARGEST``.
    """
    info = message.info
    check_numbers("map", info)
    if info.width * info.height != len(message.data):
        raise MapError(f"a map of {info.width} x {info.height} cells came with {len(message.data)} of them")
    cells = np.asarray(message.data, np.int8).reshape(info.height, info.width)
    return Grid(float_from_float32(info.resolution), pose_from_message(info.origin), cells)


def float_from_float32(value: float) -> float:
    """Returns the shortest decimal that a float32 field may have come from: 0.05, not 0.0500000007."""
    return float(str(np.float32(value)))


def message_from_grid(grid: Grid, frame: str, stamp: Any, load_time: Any | None = None) -> GridMessage:
    """Returns ``grid`` as a GridMessage in ``frame``; it shares the cells' memory.

    Args:
        grid: the map.
        frame: frame of its origin; a leading slash is dropped.
        stamp: genpy.Time of the header.
        load_time: genpy.Time the map was made or loaded; ``stamp`` where absent.
    """
    info = MapMetaData(load_time or stamp, grid.resolution, grid.cols, grid.rows, message_from_pose(grid.origin))
    return GridMessage(Header(0, stamp, stripped(frame)), info, grid.cells.reshape(-1))


class GridUpdateMessage(_Cells, OccupancyGridUpdate):  # type: ignore[misc]
    """An OccupancyGridUpdate whose ``data`` may be an int8 array when it is written. For publishers."""


class PathMessage(Path):  # type: ignore[misc]
    """A Path written from an array, because a PoseStamped object for each of hundreds of poses costs milliseconds."""

    def __init__(self, *args: Any, **fields: Any) -> None:
        super().__init__(*args, **fields)
        #: poses (x, y [m], yaw [rad]), float64, shape (n, 3), in the header's frame and at its stamp
        self.track = np.empty((0, 3))

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the header and the track's poses."""
        super().serialize(buff)
        buff.seek(-4, io.SEEK_CUR)
        buff.write(struct.pack("<I", len(self.track)))
        frame = self.header.frame_id.encode()
        head = [("seq", "<u4"), ("secs", "<u4"), ("nsecs", "<u4"), ("length", "<u4")]
        records = np.zeros(len(self.track), np.dtype([*head, ("frame", f"V{len(frame)}"), ("pose", "<f8", 7)]))
        records["secs"], records["nsecs"] = self.header.stamp.secs, self.header.stamp.nsecs
        records["length"], records["frame"] = len(frame), np.void(frame)
        records["pose"][:, :2] = self.track[:, :2]
        records["pose"][:, 5] = np.sin(self.track[:, 2] / 2.0)
        records["pose"][:, 6] = np.cos(self.track[:, 2] / 2.0)
        buff.write(records.tobytes())


def path_message(track: NDArray[np.float64], frame: str, stamp: Any) -> PathMessage:
    """Returns ``track`` (n, 3) in ``frame`` at ``stamp`` (genpy.Time) as a nav_msgs/Path."""
    message = PathMessage()
    message.header = Header(0, stamp, stripped(frame))
    message.track = track
    return message


class GetPlanArrayResponse(GetPlanResponse):  # type: ignore[misc]
    """A GetPlan response around a ``PathMessage``. For services."""

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the response: the plan's bytes and nothing else."""
        self.plan.serialize(buff)


class GetPlanArray(GetPlan):  # type: ignore[misc]
    """nav_msgs/GetPlan whose response is written from an array."""

    _response_class = GetPlanArrayResponse
