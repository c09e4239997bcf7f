import itertools
from unittest import mock

from hypothesis import given, settings
from hypothesis import strategies as st

from tcpros import frame as frame_module
from tcpros.backlog import Backlog
from tcpros.fanout import Fanout
from tcpros.frame import FrameSplitter


class FakeReceiver:
    """Accepts a set number of bytes at each attempt."""

    def __init__(self, appetite, max_messages=5, max_bytes=10_000):
        self.backlog = Backlog(max_messages, max_bytes)
        self.received = b""
        self.is_closed = False
        self.has_left = False
        self.has_joined = False
        self.unseen = 0
        self.relieved = lambda: None
        self._appetite = iter(appetite)

    @property
    def pressure(self):
        return self

    takes_directly = True

    @property
    def is_full(self):
        return self.backlog.is_full

    def take(self, data):
        count = min(next(self._appetite, 0), len(data))
        self.received += bytes(data[:count])
        return count

    def push(self, chunk):
        direct = self.backlog.direct(chunk)
        if direct is None:
            self.backlog.queue(chunk)
        else:
            self.backlog.sent(chunk, self.take(direct))
        self.flush()

    def flush(self):
        was_full = self.backlog.is_full
        data = b"".join(self.backlog.batch())
        self.backlog.advance(self.take(data))
        if was_full and not self.backlog.is_full:
            self.relieved()

    def acknowledged(self):
        return len(self.received)

    def drain(self):
        while buffers := self.backlog.batch():
            data = b"".join(buffers)
            self.received += data
            self.backlog.advance(len(data))

    def passed(self, count, ended):
        self.unseen += count
        self.backlog.passed(ended)

    def left(self):
        self.has_left = True

    def close(self, reason):
        self.is_closed = True


def frame(body):
    return len(body).to_bytes(4, "little") + body


def messages_in(stream):
    """Returns the message bodies of a stream; asserts that it consists of whole frames."""
    bodies = []
    while stream:
        length = int.from_bytes(stream[:4], "little")
        assert len(stream) >= 4 + length, "the stream ends within a frame"
        bodies.append(stream[4 : 4 + length])
        stream = stream[4 + length :]
    return bodies


def feed(fanout, stream, sizes):
    rest, position, index = b"", 0, 0
    while position < len(stream):
        size = sizes[index % len(sizes)]
        rest += stream[position : position + size]
        position, index = position + size, index + 1
        rest = rest[fanout.feed(memoryview(rest)) :]


numbered = st.lists(st.integers(min_value=0, max_value=60), max_size=40).map(
    lambda sizes: [index.to_bytes(2, "little") + b"x" * size for index, size in enumerate(sizes)]
)
cuts = st.lists(st.integers(min_value=1, max_value=200), min_size=1, max_size=30)
appetites = st.lists(st.integers(min_value=0, max_value=300), max_size=100)


@given(numbered, cuts, appetites)
@settings(max_examples=300, deadline=None)
def test_a_slow_receiver_gets_whole_messages_in_order_and_every_loss_is_counted(
    bodies, sizes, appetite
):
    fanout, receiver = Fanout(1000), FakeReceiver(appetite)
    fanout.join(receiver)
    feed(fanout, b"".join(map(frame, bodies)), sizes)
    receiver.drain()
    got = messages_in(receiver.received)
    assert got == sorted(got, key=lambda body: int.from_bytes(body[:2], "little"))
    assert set(got) <= set(bodies)
    assert len(got) + receiver.backlog.drops == len(bodies)
    assert got[-1:] == bodies[-1:], "the newest message is never the one that is dropped"


@given(numbered, cuts, st.integers(min_value=0, max_value=2000), appetites, st.booleans())
@settings(max_examples=300, deadline=None)
def test_a_newcomer_begins_with_a_whole_message_and_a_latched_one_misses_nothing_new(
    bodies, sizes, joins_at, appetite, latching
):
    fanout, receiver = Fanout(1000), FakeReceiver(appetite, max_messages=1000)
    fanout.begin(latching)
    stream = b"".join(map(frame, bodies))
    joins_at = min(joins_at, len(stream))
    rest = b""
    for position in range(joins_at):
        rest += stream[position : position + 1]
        rest = rest[fanout.feed(memoryview(rest)) :]
    ended = fanout.messages
    fanout.join(receiver)
    feed(fanout, rest + stream[joins_at:], sizes)
    receiver.drain()
    got = messages_in(receiver.received)
    if latching:
        assert got == bodies[max(0, ended - 1) :]
    else:
        assert bodies[ended + 1 :] == got or bodies[ended:] == got


@given(
    numbered,
    cuts,
    appetites,
    st.integers(min_value=0, max_value=2000),
    st.integers(min_value=0, max_value=2000),
)
@settings(max_examples=300, deadline=None)
def test_what_passes_unseen_is_in_its_place_whoever_comes_and_goes(
    bodies, sizes, appetite, comes_at, goes_at
):
    stream = b"".join(map(frame, bodies))
    fanout, receiver, other = (
        Fanout(1000),
        FakeReceiver(appetite, 1000),
        FakeReceiver(appetite, 1000),
    )
    fanout.join(receiver)
    cut, rest, position, unseen = itertools.cycle(sizes), b"", 0, 0
    with mock.patch.object(frame_module, "LARGE", 20):
        while position < len(stream):
            if position >= comes_at and not other.has_joined:
                other.has_joined = True
                fanout.join(other)
            if position >= goes_at and other.has_joined:
                fanout.remove(other)
            passage = fanout.passage()
            size = next(cut) if passage is None or passage.remaining else 4
            data = stream[position : position + size]
            if passage is not None and passage.remaining:
                assert passage.sink is receiver or passage.sink is other
                data = data[: passage.remaining]
                taken = passage.sink.take(data)
                if taken:
                    fanout.passed(taken)
                unseen += taken
                position += taken
                data = data[taken:]
            position += len(data)
            rest += data
            rest = rest[fanout.feed(memoryview(rest)) :]
    receiver.drain()
    assert receiver.received == stream
    assert fanout.messages == len(bodies)
    assert fanout.bytes == len(stream)
    assert receiver.unseen == unseen - other.unseen


def test_what_waits_is_bounded_in_messages_and_bytes():
    for max_messages, max_bytes in ((10, 10**9), (10**9, 1000)):
        fanout, receiver = Fanout(1000), FakeReceiver([], max_messages, max_bytes)
        fanout.join(receiver)
        feed(fanout, frame(b"x" * 96) * 1000, [1000])
        assert receiver.backlog.size <= 2000, "as much again may be on its way into the socket"
        assert receiver.backlog.drops == 980


def test_half_a_message_that_went_out_closes_the_receiver_when_its_source_ends():
    fanout, receiver, waiting = Fanout(1000), FakeReceiver([7]), FakeReceiver([])
    fanout.join(receiver)
    fanout.join(waiting)
    waiting.flush = lambda: None
    waiting.backlog.insert(b"header")
    feed(fanout, frame(b"x" * 20)[:12], [12])
    fanout.restart()
    assert receiver.is_closed
    assert not waiting.is_closed
    waiting.drain()
    assert waiting.received == b"header"


def test_who_leaves_within_a_message_gets_its_end_and_nothing_more():
    fanout, receiver = Fanout(1000), FakeReceiver([7])
    fanout.join(receiver)
    stream = frame(b"x" * 20) + frame(b"next")
    feed(fanout, stream[:12], [12])
    fanout.leave(receiver)
    assert not receiver.has_left
    feed(fanout, stream[12:], [100])
    assert receiver.has_left
    receiver.drain()
    assert messages_in(receiver.received) == [b"x" * 20]


def test_the_quickest_receiver_decides_whether_more_may_come():
    fanout, quick, slow = Fanout(1000), FakeReceiver([10**6] * 9), FakeReceiver([])
    relieved = []
    assert not fanout.is_full, "without receivers all is read, and forgotten"
    fanout.join(slow)
    feed(fanout, frame(b"one"), [7])
    assert fanout.is_full
    fanout.relieved = lambda: relieved.append(True)
    fanout.join(quick)
    assert relieved, "a newcomer takes more"
    feed(fanout, frame(b"two"), [7])
    assert not fanout.is_full
    fanout.remove(quick)
    assert fanout.is_full
    relieved.clear()
    slow._appetite = iter([3, 100, 100])
    for _ in range(2):
        slow.flush()
        assert not relieved
    slow.flush()
    assert relieved
    assert fanout.acknowledged() == len(slow.received) == 14


def test_who_leaves_within_a_message_is_not_kept_waiting_for_its_end():
    fanout, leaving, behind = Fanout(1000), FakeReceiver([7]), FakeReceiver([])
    fanout.join(leaving)
    fanout.join(behind)
    feed(fanout, frame(b"x" * 20)[:12], [12])
    assert fanout.is_full
    fanout.leave(leaving)
    assert not fanout.is_full


def test_one_copy_of_a_chunk_serves_all_who_wait():
    chunk = FrameSplitter(1000).split(memoryview(frame(b"abc")))
    assert chunk.stable is chunk.stable
