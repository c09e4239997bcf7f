"""The few transforms that a node needs, picked out of serialised tf2_msgs/TFMessage.

/tf carries every robot's transforms, and a node wants two or three of them. Searching a message's bytes for a
known (parent, child) pair costs a microsecond where unpacking it into objects costs some ten per transform. Only a
message in which a name was found is read record by record, so that a name's bytes inside of another field count for
nothing.
Layout (little-endian): count u32, then each: seq, secs, nsecs u32; parent; child (u32 length + text); 7 f64.
"""

import struct
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, Self

from tf2_msgs.msg import TFMessage

from nav_bundle.core.transform import Transform, fault_of
from pioneer_node.core.frame import stripped

_STAMP = struct.Struct("<II")
_LENGTH = struct.Struct("<I")
_BODY = struct.Struct("<7d")

Refuse = Callable[[str], None]
"""Called with one line for each message and each transform that cannot be used."""


class RawTFMessage(TFMessage):  # type: ignore[misc]
    """A TFMessage that keeps its bytes instead of unpacking them. For subscribers."""

    def __init__(self, *args: Any, **fields: Any) -> None:
        super().__init__(*args, **fields)
        self.buffer = b""  #: the serialised message

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


def transforms_of(buffer: bytes, refuse: Refuse) -> list[StampedTransform]:
    """Returns every usable transform of a serialised message; none of a message that does not parse."""
    return [record for _, record in _usable(_parsed(buffer, refuse), buffer, refuse)]


class _Names(NamedTuple):
    """Where a record's two names lie in a message."""

    begin: int
    middle: int
    end: int


def _parsed(buffer: bytes, refuse: Refuse) -> list[_Names]:
    """Returns where each record's names lie; none where the lengths in the message and its size do not agree."""
    try:
        return list(_walk(buffer))
    except struct.error:
        refuse(f"a tf message of {len(buffer)} bytes was dropped: it is truncated")
        return []


def _walk(buffer: bytes) -> Iterator[_Names]:
    (count,) = _LENGTH.unpack_from(buffer)
    position = 4
    for _ in range(count):
        begin = position + 4 + _STAMP.size
        middle = begin + 4 + _LENGTH.unpack_from(buffer, begin)[0]
        end = middle + 4 + _LENGTH.unpack_from(buffer, middle)[0]
        position = end + _BODY.size
        if position > len(buffer):
            raise struct.error
        yield _Names(begin, middle, end)


def _usable(places: Iterable[_Names], buffer: bytes, refuse: Refuse) -> Iterator[tuple[_Names, StampedTransform]]:
    """Yields the records at ``places`` that a tree of frames can take."""
    for names in places:
        try:
            record = _record(buffer, names)
        except UnicodeDecodeError:
            refuse("a transform was dropped: a frame's name is not UTF-8")
            continue
        fault = fault_of(record.parent, record.child, record.transform)
        if fault:
            refuse(f"a transform from {record.parent!r} to {record.child!r} was dropped: {fault}")
        else:
            yield names, record


def _record(buffer: bytes, names: _Names) -> StampedTransform:
    parent = stripped(buffer[names.begin + 4 : names.middle].decode())
    child = stripped(buffer[names.middle + 4 : names.end].decode())
    seconds, nanoseconds = _STAMP.unpack_from(buffer, names.begin - _STAMP.size)
    x, y, z, qx, qy, qz, qw = _BODY.unpack_from(buffer, names.end)
    # The same sum as genpy.Time.to_sec(), so that equal stamps are equal floats.
    return StampedTransform(parent, child, seconds + nanoseconds / 1e9, Transform((x, y, z), (qx, qy, qz, qw)))


class TransformPicker:
    """Picks the transforms of some child frames out of serialised messages.

    A message is read only where it holds the (parent, child) bytes of a child whose parent is known, or the name of
    another watched child. Not thread-safe.

    Args:
        refuse: takes one line for each message and each watched transform that is dropped.
    """

    def __init__(self, refuse: Refuse) -> None:
        self._refuse = refuse
        self._children: dict[bytes, str] = {}
        self._needles: dict[str, bytes] = {}

    def watch(self, children: Iterable[str]) -> None:
        """Picks ``children`` from now on, and learns their parents again: a child may have a new one."""
        self._needles = {child: child.encode() for child in children}
        spellings = ((spelling, child) for child in self._needles for spelling in (child, f"/{child}"))
        self._children = {spelling.encode(): child for spelling, child in spellings}

    def pick(self, buffer: bytes) -> list[StampedTransform]:
        """Returns the watched transforms in a serialised message, none of one that does not parse."""
        if not any(needle in buffer for needle in self._needles.values()):
            return []
        children = self._children
        places = _parsed(buffer, self._refuse)
        watched = [names for names in places if buffer[names.middle + 4 : names.end] in children]
        picked = []
        for names, record in _usable(watched, buffer, self._refuse):
            self._needles[record.child] = buffer[names.begin : names.end]
            picked.append(record)
        return picked
