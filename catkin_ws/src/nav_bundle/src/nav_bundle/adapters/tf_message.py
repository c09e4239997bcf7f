"""The few transforms one listens for, picked out of serialised tf2_msgs/TFMessage.

/tf carries every robot's transforms, and a node wants two or three of them. Searching a message's bytes for a
known (parent, child) pair costs a microsecond where unpacking it into objects costs some ten per transform.
Layout (little-endian): count u32, then each: seq, secs, nsecs u32; parent; child (u32 length + text); 7 f64.
"""

import struct
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, Self

from tf2_msgs.msg import TFMessage

from nav_bundle.core.transform import Transform
from pioneer_node.core.frame import stripped

_STAMP = struct.Struct("<II")
_LENGTH = struct.Struct("<I")
_BODY = struct.Struct("<7d")


class RawTFMessage(TFMessage):  # type: ignore[misc]
    """A TFMessage that keeps its bytes instead of unpacking them. For subscribers.

    Attributes:
        buffer: the serialised message.
    """

    def __init__(self, *args: Any, **fields: Any) -> None:
        super().__init__(*args, **fields)
        self.buffer = b""

    def deserialize(self, data: bytes) -> Self:
        """Keeps ``data``."""
        self.buffer = data
        return self


class StampedTransform(NamedTuple):
    """parent_from_child at ``stamp`` [s]; frames without leading slash."""

    parent: str
    child: str
    stamp: float
    transform: Transform


def transforms_of(buffer: bytes) -> Iterator[StampedTransform]:
    """Yields every transform of a serialised message."""
    for _, record in _records(buffer):
        yield record


def _records(buffer: bytes) -> Iterator[tuple[bytes, StampedTransform]]:
    """Yields each transform with the bytes of its two names."""
    (count,) = _LENGTH.unpack_from(buffer)
    position = 4
    for _ in range(count):
        names = position + 12
        parent, middle = _text(buffer, names)
        child, end = _text(buffer, middle)
        yield buffer[names:end], _record(parent, child, buffer, names, end)
        position = end + _BODY.size


def _text(buffer: bytes, position: int) -> tuple[str, int]:
    (length,) = _LENGTH.unpack_from(buffer, position)
    end = position + 4 + length
    return stripped(buffer[position + 4 : end].decode()), end


def _record(parent: str, child: str, buffer: bytes, names: int, end: int) -> StampedTransform:
    seconds, nanoseconds = _STAMP.unpack_from(buffer, names - 8)
    x, y, z, qx, qy, qz, qw = _BODY.unpack_from(buffer, end)
    # The same sum as genpy.Time.to_sec(), so that equal stamps are equal floats.
    return StampedTransform(parent, child, seconds + nanoseconds / 1e9, Transform((x, y, z), (qx, qy, qz, qw)))


class TransformPicker:
    """Picks the transforms of some child frames out of serialised messages.

    A child whose parent is known is found by its (parent, child) bytes. The names of the others are searched for,
    and a message that holds one is unpacked whole. Not thread-safe.
    """

    def __init__(self) -> None:
        self._known: dict[bytes, tuple[str, str]] = {}
        self._unknown: dict[str, bytes] = {}
        self._children: frozenset[str] = frozenset()

    def watch(self, children: Iterable[str]) -> None:
        """Picks ``children`` from now on, and learns their parents afresh: a child may have got a new one."""
        self._children = frozenset(children)
        self._unknown = {child: child.encode() for child in self._children}
        self._known = {}

    def pick(self, buffer: bytes) -> list[StampedTransform]:
        """Returns the watched transforms in a serialised message."""
        if any(name in buffer for name in self._unknown.values()):
            return self._learn(buffer)
        return [record for names in self._known for record in self._find(buffer, names)]

    def _find(self, buffer: bytes, names: bytes) -> Iterator[StampedTransform]:
        place = buffer.find(names)
        while place >= 0:
            yield _record(*self._known[names], buffer, place, place + len(names))
            place = buffer.find(names, place + len(names))

    def _learn(self, buffer: bytes) -> list[StampedTransform]:
        picked = []
        for names, record in _records(buffer):
            if record.child in self._children:
                self._known[names] = (record.parent, record.child)
                self._unknown.pop(record.child, None)
                picked.append(record)
        return picked
