"""Converts the simulator's values to messages.

Frequent messages use templates: a TCPROS frame (length, then the serialised message) is built once, and only its
numbers are overwritten.
"""

import io
import math
import struct
from collections.abc import Collection, Sequence
from typing import Any

import genpy
import numpy as np
from geometry_msgs.msg import Point, Quaternion, Twist, Vector3
from geometry_msgs.msg import Pose as PoseMessage
from nav_msgs.msg import Odometry as OdometryMessage
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image, JointState, LaserScan, PointCloud2, PointField, Range

from pioneer_gazebo.core.camera import Depth, Picture, intrinsics_of
from pioneer_gazebo.core.engine import Velocity
from pioneer_gazebo.core.pose import Pose, Vector
from pioneer_gazebo.core.robot import Camera, LaserSensor, SonarSensor

POSE_COVARIANCE = (1e-5, 1e-5, 1e12, 1e12, 1e12, 1e-3)
"""Covariance diagonal of the odometry of gazebo_ros' diff drive."""

_LENGTH = 4
_SEQ_STAMP = struct.Struct("<III")
_POSE = struct.Struct("<7d")
_SIX = struct.Struct("<6d")


def frame_of(message: Any) -> bytearray:
    """Returns a message as a TCPROS frame: its length, then its bytes."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    body = buffer.getvalue()
    return bytearray(struct.pack("<I", len(body)) + body)


def seconds_nanoseconds(time: int) -> tuple[int, int]:
    """Splits a time [ns] into whole seconds and remaining nanoseconds."""
    return divmod(time, 1_000_000_000)


def time_of(time: int) -> genpy.Time:
    """Returns a time [ns] as a genpy.Time."""
    return genpy.Time(*seconds_nanoseconds(time))


def stamped_frame(message: Any, time: int, frame_id: str) -> bytearray:
    """Returns a message's frame; its header, if any, gets the time [ns] and the frame id."""
    if hasattr(message, "header"):
        message.header.stamp, message.header.frame_id = time_of(time), frame_id
    return frame_of(message)


def clock_frame(time: int) -> bytes:
    """Returns a Clock's frame for a time [ns]."""
    return struct.pack("<III", 8, *seconds_nanoseconds(time))


class _Stamped:
    """A template that begins with a Header; ``seq`` counts its messages."""

    def __init__(self, message: Any) -> None:
        self.frame = frame_of(message)
        self._seq = 0
        self._body = _LENGTH + _SEQ_STAMP.size + 4 + len(message.header.frame_id.encode())

    def _stamp(self, time: int) -> None:
        _SEQ_STAMP.pack_into(self.frame, _LENGTH, self._seq, *seconds_nanoseconds(time))
        self._seq = (self._seq + 1) & 0xFFFFFFFF


class OdometryTemplate(_Stamped):
    """nav_msgs/Odometry with constant covariances."""

    def __init__(self, frame: str, child_frame: str, covariance: Sequence[float]) -> None:
        """Takes frame ids and the six diagonal values used for both covariances."""
        message = OdometryMessage()
        message.header.frame_id, message.child_frame_id = frame, child_frame
        message.pose.covariance = message.twist.covariance = np.diag(covariance).ravel().tolist()
        super().__init__(message)
        self._pose = self._body + 4 + len(child_frame.encode())
        self._twist = self._pose + _POSE.size + 36 * 8

    def fill(self, time: int, pose: Pose, velocity: Velocity) -> bytearray:
        """Returns the frame for a time [ns], a pose and a velocity."""
        self._stamp(time)
        _POSE.pack_into(self.frame, self._pose, *pose.position, *pose.rotation)
        _SIX.pack_into(self.frame, self._twist, *velocity.linear, *velocity.angular)
        return self.frame


class TransformTemplate:
    """One serialised transform, to be combined into a TFMessage."""

    def __init__(self, frame: str, child_frame: str) -> None:
        """Takes the frame ids of parent and child."""
        parent, child = frame.encode(), child_frame.encode()
        self._bytes = bytearray(_SEQ_STAMP.size)
        self._bytes += (
            struct.pack("<I", len(parent)) + parent + struct.pack("<I", len(child)) + child
        )
        self._pose = len(self._bytes)
        self._bytes += bytes(_POSE.size)

    def fill(self, time: int, pose: Pose) -> bytes:
        """Returns the transform's bytes for a time [ns]."""
        _SEQ_STAMP.pack_into(self._bytes, 0, 0, *seconds_nanoseconds(time))
        _POSE.pack_into(self._bytes, self._pose, *pose.position, *pose.rotation)
        return bytes(self._bytes)


def transforms_frame(transforms: Collection[bytes]) -> bytes:
    """Returns the frame of a TFMessage with these serialised transforms."""
    body = joined_transforms(transforms)
    return struct.pack("<I", len(body)) + body


def joined_transforms(transforms: Collection[bytes]) -> bytes:
    """Returns the bytes of a TFMessage with these serialised transforms."""
    return struct.pack("<I", len(transforms)) + b"".join(transforms)


def name_of_transform(transform: bytes) -> bytes:
    """Returns the part of a serialised transform that contains its frame ids."""
    return transform[_SEQ_STAMP.size : -_POSE.size]


class ScanTemplate(_Stamped):
    """sensor_msgs/LaserScan without intensities."""

    def __init__(self, config: LaserSensor, frame: str, increment: float) -> None:
        """Takes the laser's settings, the frame id and the angle between beams [rad]."""
        message = LaserScan(
            angle_min=config.min_angle, angle_max=config.max_angle, angle_increment=increment
        )
        message.header.frame_id = frame
        message.range_min, message.range_max = config.min_range, config.max_range
        message.scan_time = 1.0 / config.update_rate if config.update_rate > 0 else 0.0
        message.ranges = [0.0] * config.samples
        super().__init__(message)
        self._ranges = np.frombuffer(self.frame, "<f4", config.samples, self._body + 7 * 4 + 4)

    def fill(self, time: int, ranges: NDArray[np.float64]) -> bytearray:
        """Returns the frame for a time [ns] and ranges [m]."""
        self._stamp(time)
        self._ranges[:] = ranges
        return self.frame


class JointStateTemplate(_Stamped):
    """sensor_msgs/JointState without efforts."""

    def __init__(self, names: Sequence[str]) -> None:
        """Takes the joint names, in the order used by `fill`."""
        count = len(names)
        message = JointState(name=list(names), position=[0.0] * count, velocity=[0.0] * count)
        super().__init__(message)
        self._positions = self._body + 4 + sum(4 + len(name.encode()) for name in names) + 4
        self._velocities = self._positions + 8 * count + 4
        self._numbers = struct.Struct(f"<{count}d")

    def fill(self, time: int, states: Sequence[tuple[float, float]]) -> bytearray:
        """Returns the frame for a time [ns] and each joint's position and speed."""
        self._stamp(time)
        self._numbers.pack_into(self.frame, self._positions, *[state[0] for state in states])
        self._numbers.pack_into(self.frame, self._velocities, *[state[1] for state in states])
        return self.frame


class RangeTemplate(_Stamped):
    """sensor_msgs/Range."""

    def __init__(self, config: SonarSensor, frame: str) -> None:
        """Takes the sonar's settings and the frame id."""
        kind = Range.INFRARED if config.radiation == "infrared" else Range.ULTRASOUND
        message = Range(radiation_type=kind, field_of_view=config.fov)
        message.min_range, message.max_range = config.min_range, config.max_range
        message.header.frame_id = frame
        super().__init__(message)

    def fill(self, time: int, distance: float) -> bytearray:
        """Returns the frame for a time [ns] and a range [m]."""
        self._stamp(time)
        struct.pack_into("<f", self.frame, len(self.frame) - 4, distance)
        return self.frame


ENCODINGS = {
    "R8G8B8": "rgb8", "RGB_INT8": "rgb8", "B8G8R8": "bgr8", "BGR_INT8": "bgr8", "L8": "mono8", "L_INT8": "mono8",
}  # fmt: skip
"""Maps SDF's pixel formats to encodings of sensor_msgs/Image."""


def image_of(picture: Picture, config: Camera) -> Image:
    """Returns the Image of a picture (height, width, 3) in the camera's format, without a header."""
    encoding = ENCODINGS[config.format]
    if encoding == "mono8":
        picture = (picture @ (0.299, 0.587, 0.114)).astype("u1")
    elif encoding == "bgr8":
        picture = picture[:, :, ::-1]
    step = config.width * (1 if encoding == "mono8" else 3)
    return Image(
        height=config.height,
        width=config.width,
        encoding=encoding,
        step=step,
        data=picture.tobytes(),
    )


def depth_of(depth: Depth) -> Image:
    """Returns the Image of a depth picture [m], without a header."""
    height, width = depth.shape
    return Image(height=height, width=width, encoding="32FC1", step=4 * width, data=depth.tobytes())


def cloud_of(points: NDArray[np.float32]) -> PointCloud2:
    """Returns the PointCloud2 of points, shape (height, width, 3), without a header."""
    height, width, _ = points.shape
    fields = [
        PointField(name, 4 * index, PointField.FLOAT32, 1) for index, name in enumerate("xyz")
    ]
    return PointCloud2(
        height=height, width=width, fields=fields, point_step=12, row_step=12 * width, data=points.tobytes(),
        is_dense=False,
    )  # fmt: skip


def info_of(config: Camera) -> CameraInfo:
    """Returns the CameraInfo of a camera without distortion, without a header."""
    lens = intrinsics_of(config)
    matrix = [lens.focal, 0.0, lens.x, 0.0, lens.focal, lens.y, 0.0, 0.0, 1.0]
    return CameraInfo(
        height=config.height,
        width=config.width,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=matrix,
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0],
    )


def message_from_pose(pose: Pose) -> PoseMessage:
    """Returns a geometry_msgs/Pose."""
    return PoseMessage(Point(*pose.position), Quaternion(*pose.rotation))


def pose_from_message(message: PoseMessage) -> Pose:
    """Returns a pose; an all-zero quaternion, as in an empty message, becomes the identity rotation.

    Raises:
        ValueError: a number is not finite, or the quaternion has zero length.
    """
    p, q = message.position, message.orientation
    numbers = (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"a pose of {numbers} is not finite")
    rotation = (0.0, 0.0, 0.0, 1.0) if numbers[3:] == (0.0, 0.0, 0.0, 0.0) else numbers[3:]
    return Pose.from_quaternion(numbers[:3], rotation)


def message_from_velocity(velocity: Velocity) -> Twist:
    """Returns a geometry_msgs/Twist."""
    return Twist(Vector3(*velocity.linear), Vector3(*velocity.angular))


def velocity_from_message(message: Twist) -> Velocity:
    """Returns a velocity.

    Raises:
        ValueError: a number is not finite.
    """
    return Velocity(vector_from_message(message.linear), vector_from_message(message.angular))


def vector_from_message(message: Vector3 | Point) -> Vector:
    """Returns x, y, z.

    Raises:
        ValueError: a number is not finite.
    """
    vector = (message.x, message.y, message.z)
    if not all(map(math.isfinite, vector)):
        raise ValueError(f"{vector} is not finite")
    return vector
