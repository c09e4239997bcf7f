"""A subscriber that does not read loses frames, but never delays the publisher."""

import math
import socket
import threading
from types import SimpleNamespace

import pytest
import rospy
from sensor_msgs.msg import LaserScan, Range

from pioneer_gazebo.error import TopicError
from pioneer_gazebo.ros.mailbox import ClosedError, Mailbox
from pioneer_gazebo.ros.topic import (
    FRAMES_KEPT,
    Topic,
    _bear_late_goodbyes,
    _Outlet,
    check_type,
    publish_while_alive,
)
from pioneer_gazebo.timeline import MOST_BEHIND, Pacer


@pytest.fixture
def pair():
    ours, theirs = socket.create_server(("127.0.0.1", 0)), None
    theirs = socket.create_connection(ours.getsockname())
    accepted, _ = ours.accept()
    yield accepted, theirs
    for one in (ours, theirs, accepted):
        one.close()


class Connection:
    """A connection of rospy, which topics hold weakly."""

    def __init__(self, sock: socket.socket) -> None:
        self.socket = sock


def read_exactly(sock: socket.socket, count: int, outlet: _Outlet | None = None) -> bytes:
    """Reads ``count`` bytes. Flushes ``outlet`` before each read, as each further frame would do."""
    data = b""
    while len(data) < count:
        if outlet is not None:
            outlet._flush()
        data += sock.recv(count - len(data))
    return data


def frame(number: int) -> bytes:
    return bytes([number]) * 100_000


def test_frames_arrive_whole_and_in_order(pair) -> None:
    ours, theirs = pair
    outlet = _Outlet(SimpleNamespace(socket=ours))
    for number in range(3):
        assert outlet.send(b"%d" % number * 100)
    assert read_exactly(theirs, 300) == b"0" * 100 + b"1" * 100 + b"2" * 100


def test_a_stuck_subscriber_loses_the_oldest_frames_and_gets_the_rest_whole(pair) -> None:
    ours, theirs = pair
    outlet = _Outlet(SimpleNamespace(socket=ours))
    kept = [outlet.send(frame(number)) for number in range(200)]
    assert not all(kept)
    assert len(outlet._queue) == FRAMES_KEPT
    theirs.settimeout(20.0)
    numbers = []
    while not numbers or numbers[-1] != 199:
        data = read_exactly(theirs, 100_000, outlet)
        assert len(set(data)) == 1
        numbers.append(data[0])
    assert numbers == sorted(numbers)
    assert len(numbers) < 200


def test_a_subscriber_that_has_gone_is_reported(pair) -> None:
    ours, theirs = pair
    outlet = _Outlet(SimpleNamespace(socket=ours))
    theirs.close()

    def send_many() -> None:
        for number in range(100):
            outlet.send(frame(number))

    with pytest.raises(ConnectionError):
        send_many()


class _ClosedPublisher:
    """A publisher in the state in which rospy leaves a closed one."""

    closed = True

    def remove_connection(self, connection: object) -> None:
        for _ in None:  # type: ignore[attr-defined]
            pass


def test_a_subscriber_may_leave_a_publisher_that_is_closed_already() -> None:
    publisher = _ClosedPublisher()
    _bear_late_goodbyes(publisher)
    publisher.remove_connection(object())
    publisher.closed = False
    with pytest.raises(TypeError):
        publisher.remove_connection(object())


class _ClosedTopic:
    def publish(self, message: object) -> None:
        raise rospy.ROSException("publish() to a closed topic")


def test_what_is_published_while_the_node_shuts_down_is_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises(rospy.ROSException):
        publish_while_alive(_ClosedTopic(), None)
    monkeypatch.setattr(rospy, "is_shutdown", lambda: True)
    publish_while_alive(_ClosedTopic(), None)


def test_a_mailbox_returns_results_and_raises_errors_where_they_were_asked_for() -> None:
    mailbox, results = Mailbox(), []

    def ask() -> None:
        results.append(mailbox.call(lambda: 42))
        with pytest.raises(KeyError):
            mailbox.call(lambda: {}["missing"])
        results.append("done")

    thread = threading.Thread(target=ask)
    thread.start()
    while thread.is_alive():
        mailbox.wait(5.0)
        mailbox.serve()
        thread.join(0.001)
    assert results == [42, "done"]


def test_a_closed_mailbox_refuses_work() -> None:
    mailbox = Mailbox()
    mailbox.close()
    with pytest.raises(ClosedError):
        mailbox.call(lambda: None)


def test_pace_keeps_to_the_wall_and_gives_up_what_it_cannot_catch_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    pacer = Pacer(2.0)
    assert pacer.wait_for(1.0) == 0.0
    assert pacer.wait_for(2.0) == pytest.approx(0.5)
    now[0] += 0.6
    assert pacer.wait_for(2.0) == pytest.approx(-0.1)
    now[0] += MOST_BEHIND
    assert pacer.wait_for(2.0) == 0.0
    assert pacer.wait_for(3.0) == pytest.approx(0.5)


def test_pace_says_what_simulated_time_is_due(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    pacer = Pacer(2.0)
    assert pacer.reached() == math.inf
    pacer.wait_for(1.0)
    now[0] += 0.5
    assert pacer.reached() == pytest.approx(2.0)
    assert Pacer(0.0).reached() == math.inf


def test_as_fast_as_possible_never_waits() -> None:
    pacer = Pacer(0.0)
    assert pacer.wait_for(1e9) <= 0.0


def test_a_topic_of_another_type_is_refused_and_one_of_the_same_shares_its_outlets(pair) -> None:
    ours, theirs = pair
    connection = Connection(ours)
    first, second = (object.__new__(Topic) for _ in range(2))
    for topic in (first, second):
        topic._publisher = SimpleNamespace(impl=SimpleNamespace(connections=[connection]))
        topic._outlets, topic._stale = {}, True
    # The first topic's frame does not fit into the socket: the second one's must wait for its rest.
    first.write(b"1" * 20_000_000)
    second.write(b"2" * 100)
    [outlet] = second._outlets.values()
    data = read_exactly(theirs, 20_000_100, outlet)
    assert data == b"1" * 20_000_000 + b"2" * 100
    manager = rospy.topics.get_topic_manager()
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(manager.pubs, "/scan", SimpleNamespace(data_class=LaserScan))
        check_type("/scan", LaserScan)
        with pytest.raises(TopicError, match=r"/scan has the type sensor_msgs/LaserScan already"):
            check_type("/scan", Range)
