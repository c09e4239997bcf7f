"""Finds the boundaries of service requests and responses in a byte stream, without looking at the content.

A request is a little-endian 32-bit length and that many bytes. A response is the same after one byte: 1 for success,
0 for an error, in which case the error text replaces the response. (https://wiki.ros.org/ROS/TCPROS)
"""

import struct
from dataclasses import dataclass

from tcpros.error import TcprosError

_LENGTH = struct.Struct("<I")
_FAILED = b"\x00"


class ServiceCallError(TcprosError):
    """A request or response exceeds the size limit, or a response arrives without a request."""


class _Follower:
    """Tracks length-prefixed messages in a byte stream."""

    def __init__(self, prefix: int, max_size: int) -> None:
        self._head_size = prefix + _LENGTH.size
        self._max_size = max_size
        self._head = b""
        self._remaining = 0

    @property
    def is_within(self) -> bool:
        """Whether a message has begun and not ended."""
        return bool(self._head or self._remaining)

    def feed(self, data: memoryview) -> int:
        """Returns how many messages end in `data`. Raises ServiceCallError for one that is too long."""
        position, ended, size = 0, 0, len(data)
        while position < size:
            if not self._remaining:
                missing = self._head_size - len(self._head)
                self._head += bytes(data[position : position + missing])
                position += missing
                if len(self._head) < self._head_size:
                    break
                self._remaining = _LENGTH.unpack(self._head[-_LENGTH.size :])[0]
                if self._remaining > self._max_size:
                    raise ServiceCallError(
                        f"{self._remaining} bytes are more than {self._max_size}"
                    )
            step = min(self._remaining, size - position)
            self._remaining -= step
            position += step
            if not self._remaining:
                self._head = b""
                ended += 1
        return ended


@dataclass(slots=True)
class CallTotals:
    """Counts over all connections to one service."""

    calls: int = 0  #: complete responses so far
    bytes: int = 0  #: bytes of requests and responses so far


class Conversation:
    """Tracks the successive calls on one connection, and adds them to the totals."""

    def __init__(self, max_size: int, totals: CallTotals) -> None:
        self._totals = totals
        self._pending = 0
        self._requests = _Follower(0, max_size)
        self._responses = _Follower(1, max_size)

    def request(self, data: memoryview) -> None:
        """Processes bytes from the client. Raises ServiceCallError."""
        self._totals.bytes += len(data)
        self._pending += self._requests.feed(data)

    def response(self, data: memoryview) -> None:
        """Processes bytes from the server. Raises ServiceCallError."""
        self._totals.bytes += len(data)
        answered = self._responses.feed(data)
        self._totals.calls += answered
        self._pending -= answered

    @property
    def is_waiting(self) -> bool:
        """Whether the client still expects a response, so that closing the connection is an error for it."""
        return self._requests.is_within or self._pending > 0

    def error(self, reason: str) -> bytes:
        """Returns the error response for a pending call; b"" if no call is pending or its response has begun.

        In the latter case, the client sees the failure when the connection closes, which must follow.
        """
        if not self.is_waiting or self._responses.is_within:
            return b""
        return failure(reason)


def failure(reason: str) -> bytes:
    """Returns the response that reports a failed call."""
    text = reason.encode(errors="replace")
    return _FAILED + _LENGTH.pack(len(text)) + text
