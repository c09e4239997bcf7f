"""What of a stream of messages crosses a link, where a rule asks for less than all of it. Serialised, no clock."""

import functools
import struct
import zlib
from collections.abc import Callable

from rocon_relay.core.error import RelayError
from tcpros.core.frame import Chunk

TF_TYPES = frozenset({"tf2_msgs/TFMessage", "tf/tfMessage"})
"""Types that are one array of geometry_msgs/TransformStamped."""

LEVEL = 1
"""Of zlib: the quickest."""

SMALL, SMALL_LEVEL = 4096, 6
"""Messages of so many bytes at most are compressed at this level instead: it costs them some microseconds."""

_REMEMBERED = 8
"""Messages whose transforms, and whose compressed form, are remembered."""

MOST_KINDS = 256
"""So many kinds of messages a `StampPace` tells apart before it forgets them all."""

_LENGTH, _TIME = struct.Struct("<I"), struct.Struct("<II")
_STAMPS = {"rosgraph_msgs/Clock": 0, **dict.fromkeys(TF_TYPES, 8)}
_HEADER_STAMP = 4
_FRAMES = 16  # of the first transform: after the array's length, its seq and stamp
_STAMP = 12  # seq and stamp, before a transform's frame_id
_POSE = 56  # translation and rotation, after its child_frame_id


class DeflatedError(RelayError):
    """What should be a compressed message is none, or too long a one."""


def matching_transforms(message: memoryview, keeps: Callable[[str], bool]) -> bytes | None:
    """Returns a message of one of `TF_TYPES` with those transforms only whose child frame `keeps` accepts.

    Returns:
        None where none is left, or `message` is no such message.
    """
    transforms = _transforms(bytes(message))
    kept = [message[start:end] for child, start, end in transforms if keeps(child)]
    if len(kept) == len(transforms) > 0:
        return bytes(message)
    return b"".join((_LENGTH.pack(len(kept)), *kept)) if kept else None


@functools.lru_cache(maxsize=_REMEMBERED)
def _transforms(message: bytes) -> tuple[tuple[str, int, int], ...]:
    """Returns child frame, begin and end of each transform of a message; none where it is malformed.

    Remembered, as what is `deflated`: a fleet's robots each get the same messages.
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
    """Returns a message in zlib's format."""
    return _deflated_small(bytes(message)) if len(message) <= SMALL else zlib.compress(message, LEVEL)


@functools.lru_cache(maxsize=_REMEMBERED)
def _deflated_small(message: bytes) -> bytes:
    return zlib.compress(message, SMALL_LEVEL)


def inflated(data: memoryview, max_size: int) -> bytes:
    """Returns the message that was `deflated`. Raises DeflatedError if it is none or longer than `max_size`."""
    inflate = zlib.decompressobj()
    try:
        message = inflate.decompress(data, max_size + 1)
    except zlib.error as error:
        raise DeflatedError(f"a message that is not compressed as it should be: {error}") from None
    if not inflate.eof or inflate.unused_data or len(message) > max_size:
        raise DeflatedError(f"a compressed message is cut or longer than {max_size} bytes")
    return message


def whole_frame(message: bytes | memoryview) -> Chunk:
    """Returns a message as a frame of its own."""
    frame = memoryview(b"".join((_LENGTH.pack(len(message)), message)))
    return Chunk(frame, 0, True, len(frame), 1)


class Pace:
    """Spaces messages: after each, the next may go one period later.

    Args:
        rate: the most messages a second [Hz].
    """

    def __init__(self, rate: float) -> None:
        self._period = 1 / rate
        self._due = 0.0

    def wait(self, now: float) -> float:
        """Returns how long the next message has to wait [s]."""
        return max(0.0, self._due - now)

    def went(self, now: float) -> None:
        """Takes note that a message went."""
        self._due = now + self._period


class StampPace:
    """Picks messages by the time that they carry: of each kind the first of each period.

    One publisher may send each of its frames in a tf message of its own, or some frames less often than others; so tf
    messages are of one kind only if they are equally long and begin with the same frames. Others are all of one kind.

    Args:
        rate: periods a second [Hz].
        type_: the messages' type: a clock, one of `TF_TYPES`, or one that begins with a header.
    """

    def __init__(self, rate: float, type_: str) -> None:
        self._period = max(1, round(1e9 / rate))
        self._position = _STAMPS.get(type_, _HEADER_STAMP)
        self._has_frames = type_ in TF_TYPES
        self._last: dict[bytes, int] = {}

    def kind(self, message: memoryview) -> bytes:
        """Returns what tells messages apart that are picked each for itself."""
        try:
            end = _after_text(message, _after_text(message, _FRAMES)) if self._has_frames else 0
        except struct.error:
            return b""
        return b"%d %b" % (len(message), message[_FRAMES:end]) if end else b""

    def picks(self, message: memoryview, kind: bytes = b"") -> bool:
        """Returns whether a message of this kind is to go; one without a stamp is."""
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
