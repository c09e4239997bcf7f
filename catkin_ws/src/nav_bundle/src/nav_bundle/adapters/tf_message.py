"""Extracts the few transforms that a node needs from serialised tf2_msgs/TFMessage.

/tf carries every robot's transforms, but a node needs only two or three of them. Searching a message's bytes for a
known (parent, child) pair takes about 1 µs; unpacking it into objects takes about 10 µs per transform. A message is
parsed record by record only if the search found a name. Parsing also rejects a match inside another field.
Layout (little-endian): count u32, then per record: seq, secs, nsecs u32; parent; child (u32 length + text); 7 f64.
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
"""Called with one line for each message or transform that cannot be used."""


class RawTFMessage(TFMessage):  # type: ignore[misc]
    """A TFMessage that keeps its serialised bytes instead of unpacking them. For subscribers."""

    def __init__(self, *args: Any, **fields: Any) -> None:
        super().__init__(*args, **fields)
        self.buffer = b""  #: the serialised message

    def deserialize(self, data: bytes) -> Self:
        """Stores ``data`` in ``buffer`` without unpacking it."""
        self.buffer = data
        return self


class StampedTransform(NamedTuple):
    """parent_from_child at ``stamp`` [s]; frames without leading slash."""

    parent: str
    child: str
    stamp: float
    transform: Transform


def transforms_of(buffer: bytes, refuse: Refuse) -> list[StampedTransform]:
    """Returns every usable transform of a serialised message; an empty list if the message does not parse."""
    return [record for _, record in _usable(_parsed(buffer, refuse), buffer, refuse)]


class _Names(NamedTuple):
    """Byte offsets of a record's two frame names in a message."""

    begin: int
    middle: int
    end: int


def _parsed(buffer: bytes, refuse: Refuse) -> list[_Names]:
    """Returns the offsets of each record's names; empty if the lengths in the message do not match its size."""
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
    """Yields the valid records at ``places``; reports the others to ``refuse``."""
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
    # The same arithmetic as genpy.Time.to_sec(), so that equal stamps give equal floats.
    return StampedTransform(parent, child, seconds + nanoseconds / 1e9, Transform((x, y, z), (qx, qy, qz, qw)))


class TransformPicker:
    """Extracts the transforms of watched child frames from serialised messages.

    A message is parsed only if it contains the (parent, child) bytes of a child whose parent is known, or the name
    of a watched child whose parent is not. Not thread-safe.

    Args:
        refuse: called with one line for each message and each watched transform that is dropped.
    """

    def __init__(self, refuse: Refuse) -> None:
        self._refuse = refuse
        self._children: dict[bytes, str] = {}
        self._needles: dict[str, bytes] = {}

    def watch(self, children: Iterable[str]) -> None:
        """Watches ``children`` from now on, and learns their parents again, since a child may be reparented."""
        self._needles = {child: child.encode() for child in children}
        spellings = ((spelling, child) for child in self._needles for spelling in (child, f"/{child}"))
        self._children = {spelling.encode(): child for spelling, child in spellings}

    def pick(self, buffer: bytes) -> list[StampedTransform]:
        """Returns the watched transforms in a serialised message; an empty list if it does not parse."""
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
