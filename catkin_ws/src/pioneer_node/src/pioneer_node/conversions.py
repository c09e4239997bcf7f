"""Converts messages to their wire format."""

import io
import struct
from typing import Any

_LENGTH = struct.Struct("<I")


def frame_of(message: Any) -> bytearray:
    """Returns a message as a TCPROS frame: its length, then its bytes."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return bytearray(framed(buffer.getvalue()))


def framed(body: bytes) -> bytes:
    """Returns a serialised message with its length prefix."""
    return _LENGTH.pack(len(body)) + body
