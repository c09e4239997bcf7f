"""tf messages as bytes: one robot's transforms with its prefix taken off, and static transforms kept by frame.

A TFMessage is the number of transforms, then for each of them sequence number, stamp, parent frame, child frame and
seven doubles, little-endian, in the encoding of ROS 1.
"""

import struct
from collections.abc import Iterable, Iterator
from typing import NamedTuple

_LENGTH = struct.Struct("<I")
_SEQUENCE_AND_STAMP = 12
_TRANSLATION_AND_ROTATION = 56


class Transform(NamedTuple):
    """One transform of a TFMessage; its frames are UTF-8."""

    stamp: bytes  #: sequence number and stamp as they were
    parent: bytes
    child: bytes
    pose: bytes  #: translation and rotation, seven doubles


def transforms_in(message: bytes) -> Iterator[Transform]:
    """Yields the transforms of a TFMessage.

    Raises:
        struct.error: the message ends early.
    """
    (count,) = _LENGTH.unpack_from(message)
    start = _LENGTH.size
    for _ in range(count):
        stamp = message[start : start + _SEQUENCE_AND_STAMP]
        start += _SEQUENCE_AND_STAMP
        parent, start = _string(message, start)
        child, start = _string(message, start)
        pose = message[start : start + _TRANSLATION_AND_ROTATION]
        start += _TRANSLATION_AND_ROTATION
        if start > len(message):
            raise struct.error(f"a TFMessage of {len(message)} bytes ends within a transform")
        yield Transform(stamp, parent, child, pose)


def _string(message: bytes, start: int) -> tuple[bytes, int]:
    """Returns the string at ``start``, and where it ends."""
    (length,) = _LENGTH.unpack_from(message, start)
    end = start + _LENGTH.size + length
    return message[start + _LENGTH.size : end], end


def message_of(transforms: Iterable[Transform]) -> bytes:
    """Returns the TFMessage with these transforms."""
    parts: list[bytes] = []
    count = 0
    for stamp, parent, child, pose in transforms:
        count += 1
        parts += (
            stamp,
            _LENGTH.pack(len(parent)),
            parent,
            _LENGTH.pack(len(child)),
            child,
            pose,
        )
    return _LENGTH.pack(count) + b"".join(parts)


def by_robot(message: bytes) -> dict[str, list[Transform]]:
    """Returns the transforms of a TFMessage by robot, with the robot's prefix taken off both frames.

    Transforms whose child frame has no prefix belong to no robot.

    Raises:
        struct.error: the message ends early.
        UnicodeDecodeError: a prefix is not UTF-8.
    """
    found: dict[str, list[Transform]] = {}
    for stamp, parent, child, pose in transforms_in(message):
        robot, slash, frame = child.partition(b"/")
        if not slash:
            continue
        plain = Transform(stamp, parent.removeprefix(robot + slash), frame, pose)
        found.setdefault(robot.decode(), []).append(plain)
    return found


def in_own_frames(message: bytes | memoryview, robot: str, count: int) -> bytes:
    """Returns a message that begins with a Header, with the robot's prefix taken off its frames.

    Args:
        message: the message in the encoding of ROS 1.
        robot: the robot's name, which is the prefix.
        count: frames at the message's begin: 1 for the header's, 2 if the child frame follows at once.

    Raises:
        struct.error: the message ends early.
    """
    data = bytes(message)
    prefix = f"{robot}/".encode()
    parts = [data[:_SEQUENCE_AND_STAMP]]
    end = _SEQUENCE_AND_STAMP
    for _ in range(count):
        frame, end = _string(data, end)
        if end > len(data):
            raise struct.error(f"a message of {len(data)} bytes ends within a frame")
        own = frame.removeprefix(prefix)
        parts += (_LENGTH.pack(len(own)), own)
    return b"".join((*parts, data[end:]))


class StaticFrames:
    """The newest static transform of each child frame: several broadcasters in ROS 1 are one in ROS 2."""

    def __init__(self) -> None:
        self._frames: dict[bytes, Transform] = {}

    def merged(self, message: bytes) -> bytes:
        """Takes a TFMessage up; returns one with all frames that are known.

        Raises:
            struct.error: the message ends early; nothing is taken up.
        """
        for transform in list(transforms_in(message)):
            self._frames[transform.child] = transform
        return message_of(self._frames.values())
