"""The connection header of TCPROS, which the links between relays use too.

A header is a little-endian 32-bit length and that many bytes of fields; a field is a length of the same kind
and `key=value`. (https://wiki.ros.org/ROS/Connection%20Header)
"""

import struct
from collections.abc import Callable, Mapping

from tcpros.core.error import TcprosError

MAX_HEADER = 64 * 1024
"""Longest header that is accepted, without its own length [bytes]."""

_LENGTH = struct.Struct("<I")


class HeaderError(TcprosError):
    """What arrived is no connection header, or too long a one."""


def header_bytes(fields: Mapping[str, str]) -> bytes:
    """Returns the header that holds `fields`, its length first.

    Raises:
        HeaderError: a key is empty or holds `=`, or the whole is longer than `MAX_HEADER`.
    """
    parts = []
    for key, value in fields.items():
        if not key or "=" in key:
            raise HeaderError(f"no key of a header field: {key!r}")
        field = f"{key}={value}".encode("utf-8", "surrogateescape")
        parts += [_LENGTH.pack(len(field)), field]
    body = b"".join(parts)
    if len(body) > MAX_HEADER:
        raise HeaderError(f"a header of {len(body)} bytes is longer than {MAX_HEADER}")
    return _LENGTH.pack(len(body)) + body


def header_end(data: bytes | memoryview, start: int = 0) -> int:
    """Returns where the header that begins at `start` ends, or 0 while too little of it has arrived to tell.

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
    """Returns the fields of a header given without its own length; of a key that comes twice, the later.

    Raises:
        HeaderError: a field reaches over the end, or holds no `=`, or has an empty key.
    """
    fields, position, end = {}, 0, len(body)
    while position < end:
        if position + 4 > end:
            raise HeaderError("a header ends within a length")
        stop = position + 4 + int(_LENGTH.unpack_from(body, position)[0])
        if stop > end:
            raise HeaderError("a header field reaches over the header's end")
        key, equals, value = bytes(body[position + 4 : stop]).decode("utf-8", "surrogateescape").partition("=")
        if not equals or not key:
            raise HeaderError("a header field is not key=value")
        fields[key] = value
        position = stop
    return fields


def header_parser(use: Callable[[dict[str, str]], object], start: int = 0) -> Callable[[memoryview], int]:
    """Returns what parses a header behind `start` bytes once it is whole, and then calls `use` with its fields.

    As a stream's `parse` it returns how many bytes it has consumed, and raises HeaderError.
    """

    def parse(data: memoryview) -> int:
        end = header_end(data, start)
        if not end or len(data) < end:
            return 0
        use(header_fields(data[start + 4 : end]))
        return end

    return parse
