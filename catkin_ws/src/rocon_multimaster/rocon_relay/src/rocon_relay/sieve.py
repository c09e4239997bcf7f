"""Filters, throttles and compresses serialised messages for a link. Reads no clock."""

import functools
import struct
import zlib
from collections.abc import Callable

from rocon_relay.error import RelayError
from tcpros.frame import Chunk

TF_TYPES = frozenset({"tf2_msgs/TFMessage", "tf/tfMessage"})
"""Message types that consist of one array of geometry_msgs/TransformStamped."""

LEVEL = 1
"""zlib compression level: the fastest."""

SMALL, SMALL_LEVEL = 4096, 6
"""Size limit of small messages [bytes], and their compression level, which costs only some microseconds more."""

_REMEMBERED = 8
"""Number of messages whose transforms and compressed form are cached."""

MOST_KINDS = 256
"""Maximum number of message kinds that a `StampPace` tracks; beyond it, the table is cleared."""

_LENGTH, _TIME = struct.Struct("<I"), struct.Struct("<II")
_STAMPS = {"rosgraph_msgs/Clock": 0, **dict.fromkeys(TF_TYPES, 8)}
_HEADER_STAMP = 4
_FRAMES = 16  # of the first transform: after the array's length, its seq and stamp
_STAMP = 12  # seq and stamp, before a transform's frame_id
_POSE = 56  # translation and rotation, after its child_frame_id


class DeflatedError(RelayError):
    """A compressed message is invalid or too long."""


def matching_transforms(message: memoryview, keeps: Callable[[str], bool]) -> bytes | None:
    """Returns a message of one of `TF_TYPES` reduced to the transforms whose child frame `keeps` accepts.

    Returns:
        None if no transform is left, or `message` is malformed.
    """
    transforms = transforms_in(bytes(message))
    kept = [message[start:end] for child, start, end in transforms if keeps(child)]
    if len(kept) == len(transforms) > 0:
        return bytes(message)
    return b"".join((_LENGTH.pack(len(kept)), *kept)) if kept else None


@functools.lru_cache(maxsize=_REMEMBERED)
def transforms_in(message: bytes) -> tuple[tuple[str, int, int], ...]:
    """Returns child frame, start and end of each transform in a message; empty if it is malformed.

    Cached, like `deflated`, because all robots of a fleet get the same messages.
    """
    found = []
    try:
        (count,) = _LENGTH.unpack_from(message)
        position = _LENGTH.size
        for _ in range(count):
            start = position
            child_at = _after_text(message, start + _STAMP)
            position = _after_text(message, child_at) + _POSE
            if position > len(message):
                return ()
            child = message[child_at + _LENGTH.size : position - _POSE]
            found.append((child.decode(errors="replace"), start, position))
    except struct.error:
        return ()
    return tuple(found)


def deflated(message: memoryview) -> bytes:
    """Returns the message compressed with zlib."""
    return (
        _deflated_small(bytes(message)) if len(message) <= SMALL else zlib.compress(message, LEVEL)
    )


@functools.lru_cache(maxsize=_REMEMBERED)
def _deflated_small(message: bytes) -> bytes:
    return zlib.compress(message, SMALL_LEVEL)


def inflated(data: memoryview, max_size: int) -> bytes:
    """Returns the decompressed message. Raises DeflatedError if it is invalid or longer than `max_size`."""
    inflate = zlib.decompressobj()
    try:
        message = inflate.decompress(data, max_size + 1)
    except zlib.error as error:
        raise DeflatedError(f"a message that is not compressed as it should be: {error}") from None
    if not inflate.eof or inflate.unused_data or len(message) > max_size:
        raise DeflatedError(f"a compressed message is cut or longer than {max_size} bytes")
    return message


def whole_frame(message: bytes | memoryview) -> Chunk:
    """Returns a message as a complete frame."""
    frame = memoryview(b"".join((_LENGTH.pack(len(message)), message)))
    return Chunk(frame, 0, True, len(frame), 1)


class Pace:
    """Throttle: allows one message per period.

    Args:
        rate: maximum message rate [Hz].
    """

    def __init__(self, rate: float) -> None:
        self._period = 1 / rate
        self._due = 0.0

    def wait(self, now: float) -> float:
        """Returns how long the next message has to wait [s]."""
        return max(0.0, self._due - now)

    def went(self, now: float) -> None:
        """Records that a message was sent."""
        self._due = now + self._period


class StampPace:
    """Throttle by message stamps: picks the first message of each period and kind.

    A publisher may send each frame in a separate tf message, or some frames less often than others. So tf messages
    belong to the same kind only if they are equally long and begin with the same frames. All others are one kind.

    Args:
        rate: periods per second [Hz].
        type_: the message type: a clock, one of `TF_TYPES`, or one that begins with a header.
    """

    def __init__(self, rate: float, type_: str) -> None:
        self._period = max(1, round(1e9 / rate))
        self._position = _STAMPS.get(type_, _HEADER_STAMP)
        self._has_frames = type_ in TF_TYPES
        self._last: dict[bytes, int] = {}

    def kind(self, message: memoryview) -> bytes:
        """Returns the kind of a message; each kind is throttled separately."""
        try:
            end = _after_text(message, _after_text(message, _FRAMES)) if self._has_frames else 0
        except struct.error:
            return b""
        return b"%d %b" % (len(message), message[_FRAMES:end]) if end else b""

    def picks(self, message: memoryview, kind: bytes = b"") -> bool:
        """Returns whether to send a message of this kind; always true without a stamp."""
        if len(message) < self._position + _TIME.size:
            return True
        seconds, nanoseconds = _TIME.unpack_from(message, self._position)
        stamp = seconds * 10**9 + nanoseconds
        period, last = stamp // self._period, self._last.get(kind)
        if last is None and len(self._last) >= MOST_KINDS:
            self._last.clear()
        self._last[kind] = period
        return not stamp or period != last


def _after_text(message: bytes | memoryview, position: int) -> int:
    return position + _LENGTH.size + int(_LENGTH.unpack_from(message, position)[0])
