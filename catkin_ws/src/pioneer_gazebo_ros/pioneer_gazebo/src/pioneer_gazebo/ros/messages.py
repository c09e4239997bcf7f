"""Converts values that every part of the node uses to messages: frames, stamps, transforms, poses, velocities.

Frequent messages use templates: a TCPROS frame (length, then the serialised message) is built once, and only its
numbers are overwritten.
"""

import io
import math
import struct
from collections.abc import Collection
from typing import Any

import genpy
from geometry_msgs.msg import Point, Quaternion, Twist, Vector3
from geometry_msgs.msg import Pose as PoseMessage

from pioneer_gazebo.physics.engine import Velocity
from pioneer_gazebo.world.pose import Pose, Vector

_LENGTH = 4
_SEQ_STAMP = struct.Struct("<III")
POSE = struct.Struct("<7d")
"""A serialised geometry_msgs/Pose."""
TWIST = struct.Struct("<6d")
"""A serialised geometry_msgs/Twist."""


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


class Stamped:
    """A template that begins with a Header; ``seq`` counts its messages."""

    def __init__(self, message: Any) -> None:
        self.frame = frame_of(message)
        self._seq = 0
        self.body_start = _LENGTH + _SEQ_STAMP.size + 4 + len(message.header.frame_id.encode())

    def stamp(self, time: int) -> None:
        """Writes the header's sequence number and a time [ns]."""
        _SEQ_STAMP.pack_into(self.frame, _LENGTH, self._seq, *seconds_nanoseconds(time))
        self._seq = (self._seq + 1) & 0xFFFFFFFF


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
        self._bytes += bytes(POSE.size)

    def fill(self, time: int, pose: Pose) -> bytes:
        """Returns the transform's bytes for a time [ns]."""
        _SEQ_STAMP.pack_into(self._bytes, 0, 0, *seconds_nanoseconds(time))
        POSE.pack_into(self._bytes, self._pose, *pose.position, *pose.rotation)
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
    return transform[_SEQ_STAMP.size : -POSE.size]


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
