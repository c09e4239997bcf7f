import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcpros.frame import FrameError, FrameSplitter, control_frame, is_control


def frame(body):
    return len(body).to_bytes(4, "little") + body


bodies = st.lists(st.binary(max_size=40), max_size=20)
cuts = st.lists(st.integers(min_value=1, max_value=50), min_size=1, max_size=30)


def pieces(data, sizes):
    """Cuts data into pieces of the given sizes, repeating the sizes."""
    position, index = 0, 0
    while position < len(data):
        size = sizes[index % len(sizes)]
        yield data[position : position + size]
        position, index = position + size, index + 1


def chunks(splitter, data, sizes):
    """Yields the splitter's output for data that arrives in pieces; unused data is prepended to the next piece."""
    rest = b""
    for piece in pieces(data, sizes):
        rest += piece
        chunk = splitter.split(memoryview(rest))
        rest = rest[len(chunk.data) :]
        yield chunk
    assert rest == b""


@given(bodies, cuts)
def test_bytes_pass_unchanged_and_frames_are_counted_however_they_are_cut(messages, sizes):
    stream = b"".join(map(frame, messages))
    splitter = FrameSplitter(1000)
    got = list(chunks(splitter, stream, sizes))
    assert b"".join(bytes(chunk.data) for chunk in got) == stream
    assert sum(chunk.ended for chunk in got) == len(messages)
    assert splitter.remaining == 0


@given(bodies, cuts)
def test_head_frames_and_tail_make_up_each_chunk(messages, sizes):
    for chunk in chunks(FrameSplitter(1000), b"".join(map(frame, messages)), sizes):
        inner = list(chunk.frames())
        edges = [chunk.head, *(stop for _, stop in inner)]
        assert [start for start, _ in inner] == edges[:-1]
        assert edges[-1] == chunk.tail
        assert chunk.ended == len(inner) + (1 if chunk.head and chunk.head_ends else 0)


def test_a_length_cut_in_two_stays_for_the_next_chunk():
    splitter = FrameSplitter(1000)
    chunk = splitter.split(memoryview(frame(b"ab") + b"\x05\x00"))
    assert bytes(chunk.data) == frame(b"ab")
    assert not chunk.is_open


def test_too_long_a_message_is_an_error():
    with pytest.raises(FrameError):
        FrameSplitter(10).split(memoryview(frame(b"x" * 11)))


def test_a_control_frame_stops_the_chunk_before_it():
    control = control_frame(op="state", state="active")
    data = memoryview(frame(b"ab") + control + frame(b"c"))
    splitter = FrameSplitter(1000)
    chunk = splitter.split(data)
    assert bytes(chunk.data) == frame(b"ab")
    rest = data[len(chunk.data) :]
    assert is_control(rest)
    assert bytes(splitter.split(rest[len(control) :]).data) == frame(b"c")
