import contextlib
import random
import socket

import pytest

from tcpros.pipe import Pipe


@pytest.fixture
def pipe():
    made = Pipe()
    yield made
    made.close()


@pytest.fixture
def ends():
    """Four sockets: data written to the first is moved from the second to the third and arrives at the last."""
    pairs = (*socket.socketpair(), *socket.socketpair())
    for end in pairs:
        end.setblocking(False)
    yield pairs
    for end in pairs:
        end.close()


def test_bytes_that_the_sink_has_no_room_for_come_back(pipe, ends):
    writer, source, sink, reader = ends
    sink.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 20_000)
    sent, got = random.Random(3).randbytes(3_000_000), b""
    written, returned = 0, 0
    while len(got) < len(sent):
        with contextlib.suppress(BlockingIOError):
            written += writer.send(sent[written:])
        moved = pipe.move(source.fileno(), sink.fileno(), len(sent))
        returned += len(moved.rest)
        got += drained(reader) + moved.rest
    assert got == sent
    assert returned > 0


def test_no_more_is_moved_than_asked(pipe, ends):
    writer, source, sink, reader = ends
    writer.send(b"message, next")
    assert pipe.move(source.fileno(), sink.fileno(), 7) == (7, b"")
    assert reader.recv(100) == b"message"
    assert source.recv(100) == b", next"


def test_a_source_without_bytes_blocks_and_one_that_ended_gives_none(pipe, ends):
    writer, source, sink, _reader = ends
    with pytest.raises(BlockingIOError):
        pipe.move(source.fileno(), sink.fileno(), 7)
    writer.close()
    assert pipe.move(source.fileno(), sink.fileno(), 7) == (0, b"")
    assert pipe.is_usable


def test_a_sink_that_is_gone_takes_nothing_and_the_pipe_continues(pipe, ends):
    writer, source, sink, reader = ends
    reader.close()
    writer.send(b"message")
    assert pipe.move(source.fileno(), sink.fileno(), 7) == (0, b"message")
    assert pipe.is_usable


def drained(reader):
    """Returns all data that is available."""
    data = b""
    with contextlib.suppress(BlockingIOError):
        while more := reader.recv(2**20):
            data += more
    return data
