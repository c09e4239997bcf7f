"""Messages as they are on the wire."""

import io
import struct
from typing import Any

_LENGTH = struct.Struct("<I")


def frame_of(message: Any) -> bytearray:
    """Returns a message as TCPROS carries it: its length, then its bytes."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return bytearray(framed(buffer.getvalue()))


def framed(body: bytes) -> bytes:
    """Returns a serialised message with its length before it."""
    return _LENGTH.pack(len(body)) + body
