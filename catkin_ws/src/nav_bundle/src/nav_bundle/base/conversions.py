"""Conversions between the messages and values that all rooms use; each room has its own for the others.

Every ``…_from_message`` checks its input: a number that is not finite or exceeds ``LARGEST`` raises a
``MessageError`` that names the field. This is the boundary at which the kernels' assumptions are checked: code that
uses the converted values does not have to check again.
"""

import io
import math
import struct
from collections.abc import Iterator
from typing import Any, Self

import genpy
import numpy as np
from geometry_msgs.msg import Point, PoseStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMessage
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header

from nav_bundle.base.error import MessageError, ObservationError
from nav_bundle.base.pose import LARGEST, Pose
from nav_bundle.base.scan import LONGEST, Scan
from nav_bundle.base.transform import Transform
from pioneer_node.core.frame import stripped


def write_at_end(buff: io.BytesIO, items: NDArray[Any]) -> None:
    """Writes an array's items in place of the empty array that ends a serialised message."""
    buff.seek(-4, io.SEEK_CUR)
    buff.write(struct.pack("<I", len(items)))
    buff.write(np.ascontiguousarray(items).data)


def pose_fields(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the seven numbers of each pose (x, y [m], yaw [rad]; shape (n, 3)) at z = 0, shape (n, 7)."""
    fields = np.zeros((len(poses), 7))
    fields[:, :2] = poses[:, :2]
    fields[:, 5] = np.sin(poses[:, 2] / 2.0)
    fields[:, 6] = np.cos(poses[:, 2] / 2.0)
    return fields


class ArrayFields(genpy.Message):  # type: ignore[misc]
    """Mixin for a message whose sequences of numbers are deserialised as arrays."""

    def deserialize(self, data: bytes) -> Self:
        """Reads the message from ``data``."""
        return self.deserialize_numpy(data, np)


class CellFields(genpy.Message):  # type: ignore[misc]
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
        write_at_end(buff, cells.ravel())


class ScanMessage(ArrayFields, LaserScan):  # type: ignore[misc]
    """A LaserScan whose ``ranges`` and ``intensities`` are deserialised as float32 arrays. For subscribers."""


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


def scan_from_message(message: LaserScan, base_from_laser: Transform) -> Scan:
    """Returns the scan of a LaserScan or ScanMessage in the robot's frame; reverses the angles of an inverted laser.

    Raises:
        ObservationError: an angle is not finite, a range limit is NaN, or ``range_max`` is not positive.
    """
    shortest, longest = range_limits(message)
    side = 1.0 if base_from_laser.upright() else -1.0
    return Scan(
        np.asarray(message.ranges, np.float32),
        side * message.angle_min,
        side * message.angle_increment,
        shortest,
        longest,
        base_from_laser.planar(),
    )


def range_limits(message: LaserScan) -> tuple[float, float]:
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
