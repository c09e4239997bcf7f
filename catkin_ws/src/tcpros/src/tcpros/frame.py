"""Finds message boundaries in a byte stream, without looking at the content.

A frame is a little-endian 32-bit length and a serialised message of that many bytes, as in TCPROS. Links between
relays carry the same frames plus control frames: a length that no message can have (`CONTROL`), then a connection
header.
"""

import functools
import struct
from collections.abc import Iterator

from tcpros.error import TcprosError
from tcpros.header import header_bytes

CONTROL = 0xFFFFFFFF
CONTROL_MARK = b"\xff\xff\xff\xff"

LENGTH_SIZE = 4
"""Size of a frame's length [bytes]."""

MAX_MESSAGE = 256 * 2**20
"""Maximum size of a node's message [bytes]."""

LARGE = 512 * 1024
"""Minimum size from which splicing a message is cheaper than reading it (measured) [bytes]."""

_LENGTH = struct.Struct("<I")
_unpack = _LENGTH.unpack_from


class FrameError(TcprosError):
    """A frame announces more bytes than a message may have."""


def control_frame(**fields: str) -> bytes:
    """Returns the control frame that holds `fields`."""
    return CONTROL_MARK + header_bytes(fields)


class Chunk:
    """Consecutive bytes of a stream of frames, no length cut in two."""

    __slots__ = ("__dict__", "data", "ended", "head", "head_ends", "tail")

    def __init__(self, data: memoryview, head: int, head_ends: bool, tail: int, ended: int) -> None:
        self.data = data  #: the bytes. Valid only until the next chunk is read: see `stable`.
        self.head = head  #: number of leading bytes that continue an earlier frame; the next frame begins there
        self.head_ends = head_ends  #: whether that frame ends with them; also true if `head` is 0
        self.tail = tail  #: start of the frame that continues after this chunk; `len(data)` if there is none
        self.ended = ended  #: number of frames that end in this chunk

    @property
    def is_open(self) -> bool:
        """Whether the last frame continues after this chunk."""
        return self.tail < len(self.data) or not self.head_ends

    @functools.cached_property
    def stable(self) -> memoryview:
        """A copy of the bytes that may be kept; made once and shared."""
        return memoryview(bytes(self.data))

    def frames(self) -> Iterator[tuple[int, int]]:
        """Yields start and end of every frame that lies completely in this chunk."""
        position, data, tail = self.head, self.data, self.tail
        while position < tail:
            stop = position + 4 + _unpack(data, position)[0]
            yield position, stop
            position = stop


class FrameSplitter:
    """Tracks the frame boundaries of one stream."""

    def __init__(self, max_message_size: int) -> None:
        self.remaining = 0  #: missing bytes of the arriving frame; 0 between two frames
        self.is_large = False  #: whether the newest frame has at least `LARGE` bytes and did not arrive all at once
        self._limit = max_message_size

    def split(self, data: memoryview) -> Chunk:
        """Returns the leading part of `data` that can be forwarded.

        This is all of it except an incomplete length, or a control frame (see `is_control`) and what follows it.

        Raises:
            FrameError: a message is longer than allowed.
        """
        end = len(data)
        head = position = min(self.remaining, end)
        ended = 1 if head and head == self.remaining else 0
        self.remaining -= head
        head_ends = not self.remaining
        tail = end
        while end - position >= 4:
            length = _unpack(data, position)[0]
            if length > self._limit:
                if length == CONTROL:
                    break
                raise FrameError(f"a message of {length} bytes is longer than {self._limit}")
            stop = position + 4 + length
            if stop > end:
                tail, position, self.remaining = position, end, stop - end
                break
            position = stop
            ended += 1
        if position > head:
            self.is_large = self.remaining > 0 and length >= LARGE
        return Chunk(data[:position], head, head_ends, min(tail, position), ended)


def is_control(data: memoryview) -> bool:
    """Returns whether `data`, which starts at a frame boundary, begins with a control frame."""
    return data[:4] == CONTROL_MARK
