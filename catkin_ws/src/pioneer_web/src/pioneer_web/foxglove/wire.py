"""Encodes and decodes frames of the Foxglove WebSocket protocol (foxglove.websocket.v1)."""

import dataclasses
import json
import struct
from collections.abc import Mapping
from typing import Any

PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
ENCODING = "ros1"
MOST = 10_000
"""Maximum number of entries in one request of a client, such as subscriptions or channels."""


class WireError(ValueError):
    """A frame violates the protocol; the message gives the reason."""


@dataclasses.dataclass(frozen=True)
class Message:
    """A message that a client publishes on one of its channels."""

    channel: int
    body: bytes


@dataclasses.dataclass(frozen=True)
class Call:
    """A service call of a client."""

    service: int
    number: int
    body: bytes


def message_frame(subscription: int, stamp: int, body: bytes) -> bytes:
    """Returns a message frame for a client; ``stamp`` is the time of reception [ns]."""
    return struct.pack("<BIQ", 1, subscription, stamp) + body


def response_frame(call: Call, body: bytes) -> bytes:
    """Returns a service response frame."""
    return (
        struct.pack("<BIII", 3, call.service, call.number, len(ENCODING)) + ENCODING.encode() + body
    )


def frame_from_client(data: bytes) -> Message | Call:
    """Decodes a client's binary frame.

    Raises:
        WireError: the frame is too short, or its kind or encoding is unknown.
    """
    if len(data) >= 5 and data[0] == 1:
        return Message(struct.unpack_from("<I", data, 1)[0], data[5:])
    if len(data) >= 13 and data[0] == 2:
        service, number, length = struct.unpack_from("<III", data, 1)
        if data[13 : 13 + length] != ENCODING.encode():
            raise WireError(f"requests must be encoded as {ENCODING}")
        return Call(service, number, data[13 + length :])
    raise WireError("unknown or short binary frame")


def request_from_text(text: str) -> tuple[str, Mapping[str, Any]]:
    """Returns operation and fields of a client's JSON request.

    Raises:
        WireError: it is not a JSON object with an ``op``.
    """
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError):
        raise WireError("a text frame must be JSON") from None
    if not isinstance(fields, dict) or not isinstance(fields.get("op"), str):
        raise WireError("a text frame must be an object with 'op'")
    return fields["op"], fields


def rows(fields: Mapping[str, Any], name: str, **kinds: type) -> list[dict[str, Any]]:
    """Returns a list of objects that have at least the fields ``kinds``, with these types.

    Raises:
        WireError: the field is not such a list, or it is too long.
    """
    found = fields.get(name)
    if not isinstance(found, list) or len(found) > MOST:
        raise WireError(f"'{name}' must be a list of at most {MOST}")
    for one in found:
        if not isinstance(one, dict) or not all(
            type(one.get(key)) is kind for key, kind in kinds.items()
        ):
            raise WireError(f"'{name}' must hold {', '.join(kinds)}")
    return found


def numbers(fields: Mapping[str, Any], name: str) -> list[int]:
    """Returns a list of integers.

    Raises:
        WireError: it is something else, or too long.
    """
    found = fields.get(name)
    if (
        not isinstance(found, list)
        or len(found) > MOST
        or not all(type(one) is int for one in found)
    ):
        raise WireError(f"'{name}' must be a list of whole numbers")
    return found
