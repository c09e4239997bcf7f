"""Extracts the few transforms that a node needs from serialised tf2_msgs/TFMessage.

/tf carries every robot's transforms, but a node needs only two or three of them. Searching a message's bytes for a
known (parent, child) pair takes about 1 µs; unpacking it into objects takes about 10 µs per transform. A message is
parsed record by record only if the search found a name. Parsing also rejects a match inside another field.
Layout (little-endian): count u32, then per record: seq, secs, nsecs u32; parent; child (u32 length + text); 7 f64.
"""

import struct
from collections.abc import Callable, Container, Iterable, Iterator
from typing import Any, NamedTuple, Self

from tf2_msgs.msg import TFMessage

from nav_bundle.base.transform import Transform, fault_of
from pioneer_node.core.frame import stripped

_STAMP = struct.Struct("<II")
_LENGTH = struct.Struct("<I")
_BODY = struct.Struct("<7d")

_MISSES = 20
"""Number of messages after which the parent of a watched frame is looked for again."""

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
    return [record for _, record in _records(buffer, refuse)]


def _records(
    buffer: bytes, refuse: Refuse, children: Container[bytes] | None = None
) -> Iterator[tuple[bytes, StampedTransform]]:
    """Yields each usable record, and the bytes of its two names; None as ``children`` stands for all child frames.

    Reports unusable records to ``refuse``. Yields none if the lengths in the message do not match its size.
    """
    try:
        places = list(_places(buffer))
    except struct.error:
        refuse(f"a tf message of {len(buffer)} bytes was dropped: it is truncated")
        return
    for begin, middle, end in places:
        name = buffer[middle + 4 : end]
        if children is not None and name not in children:
            continue
        try:
            parent, child = stripped(buffer[begin + 4 : middle].decode()), stripped(name.decode())
        except UnicodeDecodeError:
            refuse("a transform was dropped: a frame's name is not UTF-8")
            continue
        seconds, nanoseconds = _STAMP.unpack_from(buffer, begin - _STAMP.size)
        x, y, z, qx, qy, qz, qw = _BODY.unpack_from(buffer, end)
        transform = Transform((x, y, z), (qx, qy, qz, qw))
        if fault := fault_of(parent, child, transform):
            refuse(f"a transform from {parent!r} to {child!r} was dropped: {fault}")
        else:
            # The same arithmetic as genpy.Time.to_sec(), so that equal stamps give equal floats.
            yield (
                buffer[begin:end],
                StampedTransform(parent, child, seconds + nanoseconds / 1e9, transform),
            )


def _places(buffer: bytes) -> Iterator[tuple[int, int, int]]:
    """Yields the offsets of each record's two names and of the byte after them."""
    (count,) = _LENGTH.unpack_from(buffer)
    position = 4
    for _ in range(count):
        begin = position + 4 + _STAMP.size
        middle = begin + 4 + _LENGTH.unpack_from(buffer, begin)[0]
        end = middle + 4 + _LENGTH.unpack_from(buffer, middle)[0]
        position = end + _BODY.size
        if position > len(buffer):
            raise struct.error
        yield begin, middle, end


class TransformPicker:
    """Extracts the transforms of watched child frames from serialised messages.

    A message is parsed only if it contains the (parent, child) bytes of a child whose parent is known, or the name
    of a watched child whose parent is not. A child that comes without its known parent, in ``_MISSES`` messages in a
    row, has a new one, or is only another frame's parent in them: it is parsed by name again. Not thread-safe.

    Args:
        refuse: called with one line for each message and each watched transform that is dropped.
    """

    def __init__(self, refuse: Refuse) -> None:
        self._refuse = refuse
        self._children: set[bytes] = set()
        self._needles: dict[str, bytes] = {}
        self._names: dict[str, bytes] = {}
        self._misses: dict[str, int] = {}

    def watch(self, children: Iterable[str]) -> None:
        """Watches ``children`` from now on, and learns their parents again, since a child may be reparented."""
        self._names = {child: child.encode() for child in children}
        self._needles = dict(self._names)
        self._misses = dict.fromkeys(self._names, 0)
        self._children = {
            spelling for name in self._names.values() for spelling in (name, b"/" + name)
        }

    def pick(self, buffer: bytes) -> list[StampedTransform]:
        """Returns the watched transforms in a serialised message; an empty list if it does not parse."""
        if not self._concerns(buffer):
            return []
        picked = []
        for names, record in _records(buffer, self._refuse, self._children):
            self._needles[record.child] = names
            self._misses[record.child] = 0
            picked.append(record)
        return picked

    def _concerns(self, buffer: bytes) -> bool:
        """Returns whether a message may hold a transform of a watched child."""
        concerns = False
        for child, name in self._names.items():
            if name not in buffer:
                continue
            if self._needles[child] in buffer:
                concerns = True
                self._misses[child] = 0
            else:
                self._misses[child] += 1
                concerns = concerns or self._misses[child] >= _MISSES
        return concerns
