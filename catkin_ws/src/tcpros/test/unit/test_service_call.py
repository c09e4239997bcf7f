"""Requests and responses are tracked however the bytes are split."""

import random
import struct

import pytest

from tcpros.service_call import CallTotals, Conversation, ServiceCallError


def request(body: bytes) -> bytes:
    return struct.pack("<I", len(body)) + body


def response(body: bytes, good: bool = True) -> bytes:
    return bytes([good]) + request(body)


def cut(data: bytes, generator: random.Random) -> list[memoryview]:
    """Cuts the bytes into pieces."""
    places = sorted(generator.randrange(len(data) + 1) for _ in range(generator.randrange(12)))
    return [memoryview(data)[a:b] for a, b in zip([0, *places], [*places, len(data)], strict=True)]


@pytest.mark.parametrize("seed", range(50))
def test_calls_are_counted_however_they_are_cut(seed: int) -> None:
    generator = random.Random(seed)
    sizes = [generator.choice((0, 1, 3, 4, 5, 300)) for _ in range(6)]
    totals = CallTotals()
    conversation = Conversation(300, totals)
    for number, size in enumerate(sizes):
        assert not conversation.is_waiting
        for piece in cut(request(bytes(size)), generator):
            conversation.request(piece)
        assert conversation.is_waiting
        for piece in cut(response(bytes(size), bool(size % 2)), generator):
            conversation.response(piece)
        assert totals.calls == number + 1
    assert totals.bytes == sum(4 + 5 + 2 * size for size in sizes)


def test_who_waits_for_a_whole_response_gets_an_error_as_one() -> None:
    conversation = Conversation(100, CallTotals())
    assert conversation.error("gone") == b""
    conversation.request(memoryview(request(b"abc"))[:2])
    assert conversation.error("gone") == response(b"gone", good=False)
    conversation.request(memoryview(request(b"abc"))[2:])
    assert conversation.error("gone") == response(b"gone", good=False)
    conversation.response(memoryview(response(b"abc"))[:3])
    assert conversation.error("gone") == b"", (
        "half a response is out: only the end of the connection can tell"
    )
    conversation.response(memoryview(response(b"abc"))[3:])
    assert conversation.error("gone") == b""


def test_more_than_is_allowed_is_an_error_at_its_length() -> None:
    with pytest.raises(ServiceCallError, match="101 bytes are more than 100"):
        Conversation(100, CallTotals()).request(memoryview(struct.pack("<I", 101)))
    with pytest.raises(ServiceCallError):
        Conversation(100, CallTotals()).response(memoryview(b"\x01" + struct.pack("<I", 101)))
