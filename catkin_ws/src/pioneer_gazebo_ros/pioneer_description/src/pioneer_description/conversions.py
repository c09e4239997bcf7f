"""Decodes messages to values without creating message objects."""

import struct
from typing import NamedTuple

_HEADER = struct.Struct("<4I")
_COUNT = struct.Struct("<I")


class MalformedMessageError(Exception):
    """A received message does not have the expected type."""


class JointPositions(NamedTuple):
    """The joint positions in a JointState."""

    time: int  #: [ns]
    names: tuple[str, ...]  #: joint names
    positions: tuple[float, ...]  #: one per joint [rad or m]


def joint_positions(message: bytes | memoryview) -> JointPositions:
    """Returns the positions in a serialised sensor_msgs/JointState.

    Raises:
        MalformedMessageError: it is not a JointState, or the numbers of names and positions differ.
    """
    try:
        _, seconds, nanoseconds, length = _HEADER.unpack_from(message)
        names, start = _names(message, _HEADER.size + length)
        (count,) = _COUNT.unpack_from(message, start)
        if count != len(names):
            raise MalformedMessageError(f"it has {len(names)} joints and {count} positions")
        positions = struct.unpack_from(f"<{count}d", message, start + _COUNT.size)
    except (struct.error, UnicodeDecodeError) as error:
        raise MalformedMessageError(f"it is no JointState: {error}") from None
    return JointPositions(seconds * 1_000_000_000 + nanoseconds, names, positions)


def _names(message: bytes | memoryview, start: int) -> tuple[tuple[str, ...], int]:
    (count,) = _COUNT.unpack_from(message, start)
    start += _COUNT.size
    names = []
    for _ in range(count):
        (length,) = _COUNT.unpack_from(message, start)
        stop = start + _COUNT.size + length
        names.append(bytes(message[start + _COUNT.size : stop]).decode())
        start = stop
    return tuple(names), start
