"""The publishing thread writes to a subscriber's socket, messages whole and in order, whatever the subscriber does."""

import random
import socket
import struct
import threading
from collections.abc import Iterator

import pytest
from rospy.exceptions import TransportException
from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_pubsub import TCPROSPub
from std_msgs.msg import String

from pioneer_harness.wait import wait_until
from pioneer_launch.direct_connection import DirectConnection

PATIENCE = 20.0
Pair = tuple[TCPROSTransport, socket.socket]


@pytest.fixture
def ends() -> Iterator[Pair]:
    """Yields a publisher's transport, as rospy creates it, and the subscriber's socket."""
    ours, theirs = socket.socketpair()
    for one in (ours, theirs):
        one.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
    theirs.settimeout(PATIENCE)
    transport = TCPROSTransport(TCPROSPub("/topic", String), "/topic")
    transport.set_socket(ours, "subscriber")
    yield transport, theirs
    theirs.close()
    transport.close()


def frame(number: int, size: int = 8) -> bytes:
    body = struct.pack("<I", number) * (size // 4)
    return struct.pack("<I", len(body)) + body


def received(subscriber: socket.socket, until: int) -> list[int]:
    """Returns the numbers of the frames up to ``until``; fails if a frame is incomplete."""

    def exactly(count: int) -> bytes:
        data = b""
        while len(data) < count:
            part = subscriber.recv(count - len(data))
            assert part, "the stream has ended"
            data += part
        return data

    numbers: list[int] = []
    while not numbers or numbers[-1] != until:
        body = exactly(*struct.unpack("<I", exactly(4)))
        numbers.append(struct.unpack_from("<I", body)[0])
        assert body == struct.pack("<I", numbers[-1]) * (len(body) // 4)
    return numbers


def writers() -> list[threading.Thread]:
    return [one for one in threading.enumerate() if one.name == "slow-subscriber"]


def test_a_message_is_on_its_way_when_the_call_returns_and_takes_no_thread(ends: Pair) -> None:
    transport, subscriber = ends
    connection = DirectConnection(transport, 1)
    for number in range(5):
        assert connection.write_data(frame(number))
        assert not writers()
    subscriber.setblocking(False)
    assert received(subscriber, 4) == [0, 1, 2, 3, 4]
    assert (transport.stat_num_msg, transport.stat_bytes) == (5, 5 * len(frame(0)))


def test_a_slow_subscriber_delays_nobody_and_gets_the_newest(ends: Pair) -> None:
    transport, subscriber = ends
    connection = DirectConnection(transport, 3)
    for number in range(500):
        connection.write_data(frame(number, 4000))
    first, *rest = received(subscriber, 499)
    assert first == 0
    assert rest[-3:] == [497, 498, 499]
    assert rest == sorted(rest)
    assert len(rest) < 100
    wait_until(lambda: not writers(), "the end of the thread that wrote what was left", PATIENCE)
    connection.write_data(frame(1000))
    assert not writers()
    assert received(subscriber, 1000) == [1000]


def test_without_a_bound_nothing_is_lost(ends: Pair) -> None:
    transport, subscriber = ends
    connection = DirectConnection(transport, 0)
    for number in range(300):
        connection.write_data(frame(number, 4000))
    assert received(subscriber, 299) == list(range(300))


@pytest.mark.parametrize("seed", range(5))
def test_frames_stay_whole_and_in_order_at_any_pace(ends: Pair, seed: int) -> None:
    transport, subscriber = ends
    chance, connection = random.Random(seed), DirectConnection(transport, 4)
    sizes = [chance.choice([4, 400, 6000, 40000]) for _ in range(400)]
    found: list[int] = []
    reader = threading.Thread(target=lambda: found.extend(received(subscriber, len(sizes))))
    reader.start()
    for number, size in enumerate(sizes):
        connection.write_data(frame(number, size))
        if not chance.randrange(10):
            wait_until(lambda: not writers(), "the subscriber to have caught up", PATIENCE)
    wait_until(lambda: not writers(), "the subscriber to have caught up", PATIENCE)
    connection.write_data(frame(len(sizes)))
    reader.join(PATIENCE)
    assert found == sorted(set(found))
    assert found[-1] == len(sizes)


def test_the_publisher_hears_of_a_subscriber_that_has_gone(ends: Pair) -> None:
    transport, subscriber = ends
    connection = DirectConnection(transport, 1)
    subscriber.close()
    with pytest.raises((TransportException, OSError)):
        connection.write_data(frame(0))
    with pytest.raises(TransportException):
        connection.write_data(frame(1))


def test_the_publisher_hears_of_a_subscriber_that_went_while_messages_waited(ends: Pair) -> None:
    transport, subscriber = ends
    connection = DirectConnection(transport, 1)
    for number in range(10):
        connection.write_data(frame(number, 40000))
    subscriber.close()
    wait_until(lambda: not writers(), "the end of the thread that wrote", PATIENCE)
    with pytest.raises((TransportException, OSError)):
        connection.write_data(frame(10))


def test_what_waited_for_a_subscriber_that_has_gone_is_dropped_and_each_later_message_fails(
    ends: Pair,
) -> None:
    """The queue used to be kept after the subscriber had closed, and grew without limit and without an error."""
    transport, subscriber = ends
    connection = DirectConnection(transport, 0)
    for number in range(10):
        connection.write_data(frame(number, 40000))
    subscriber.close()
    wait_until(lambda: not writers(), "the end of the thread that wrote", PATIENCE)
    for number in range(3):
        with pytest.raises((TransportException, OSError)):
            connection.write_data(frame(number))
    assert not writers()
