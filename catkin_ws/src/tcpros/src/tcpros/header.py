"""The TCPROS connection header, also used by the links between relays.

A header is a little-endian 32-bit length and that many bytes of fields; a field is a length of the same kind
and `key=value`. (https://wiki.ros.org/ROS/Connection%20Header)
"""

import struct
from collections.abc import Callable, Mapping

from tcpros.error import TcprosError

MAX_HEADER = 64 * 1024
"""Maximum size of a header, without its length prefix [bytes]."""

MAX_TEXT = 1000
"""Longer texts of peers are cut [characters]."""

_LENGTH = struct.Struct("<I")


class HeaderError(TcprosError):
    """The data is not a connection header, or the header is too long."""


def printable(text: str) -> str:
    """Returns a peer's text as it may be logged, and sent in messages and XML.

    A header's fields hold any bytes. What is no printable character, invalid UTF-8 included, becomes U+FFFD.
    """
    if len(text) > MAX_TEXT:
        text = text[: MAX_TEXT - 1] + "…"
    if text.isprintable():
        return text
    return "".join(character if character.isprintable() else "\ufffd" for character in text)


def header_bytes(fields: Mapping[str, str]) -> bytes:
    """Returns the header with `fields`, including its length prefix.

    Raises:
        HeaderError: a key is empty or holds `=`, or the whole is longer than `MAX_HEADER`.
    """
    parts = []
    for key, value in fields.items():
        if not key or "=" in key:
            raise HeaderError(f"invalid key of a header field: {key!r}")
        field = f"{key}={value}".encode("utf-8", "surrogateescape")
        parts += [_LENGTH.pack(len(field)), field]
    body = b"".join(parts)
    if len(body) > MAX_HEADER:
        raise HeaderError(f"a header of {len(body)} bytes is longer than {MAX_HEADER}")
    return _LENGTH.pack(len(body)) + body


def header_end(data: bytes | memoryview, start: int = 0) -> int:
    """Returns where the header that begins at `start` ends, or 0 if its length has not arrived yet.

    Raises:
        HeaderError: it announces more than `MAX_HEADER` bytes.
    """
    if len(data) < start + 4:
        return 0
    length = _LENGTH.unpack_from(data, start)[0]
    if length > MAX_HEADER:
        raise HeaderError(f"a header of {length} bytes is longer than {MAX_HEADER}")
    return start + 4 + int(length)


def header_fields(body: bytes | memoryview) -> dict[str, str]:
    """Returns the fields of a header given without its length prefix. If a key is repeated, the last value counts.

    Raises:
        HeaderError: a field exceeds the header, has no `=`, or has an empty key.
    """
    fields, position, end = {}, 0, len(body)
    while position < end:
        if position + 4 > end:
            raise HeaderError("a header ends within a length")
        stop = position + 4 + int(_LENGTH.unpack_from(body, position)[0])
        if stop > end:
            raise HeaderError("a header field reaches over the header's end")
        key, equals, value = (
            bytes(body[position + 4 : stop]).decode("utf-8", "surrogateescape").partition("=")
        )
        if not equals or not key:
            raise HeaderError("a header field is not key=value")
        fields[key] = value
        position = stop
    return fields


def header_parser(
    use: Callable[[dict[str, str]], object], start: int = 0
) -> Callable[[memoryview], int]:
    """Returns a parser that skips `start` bytes, waits for a complete header and calls `use` with its fields.

    The parser fits a stream's `parse`: it returns how many bytes it has consumed. It raises HeaderError.
    """

    def parse(data: memoryview) -> int:
        end = header_end(data, start)
        if not end or len(data) < end:
            return 0
        use(header_fields(data[start + 4 : end]))
        return end

    return parse
