"""The TCP connections that carry messages: how many there are, and their socket options."""

import contextlib
import socket
from pathlib import Path

import pytest
from relay_side import Subscriber, connect, number_of_good

from pioneer_harness.wait import wait_until
from tcpros.stream import Stream

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

ESTABLISHED = "01"


def connections_to(port):
    """Returns how many established connections to `port` this machine has, according to the kernel."""
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return sum(int(row[2].split(":")[1], 16) == port and row[3] == ESTABLISHED for row in rows)


def waits_for_nagle(side):
    """Returns kind and use of Nagle's algorithm for each of the relay's open connections; none can end meanwhile."""
    found = []

    def look():
        streams = [one for one in side.relay._reactor._handlers.values() if isinstance(one, Stream)]
        waits = [
            not one._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) for one in streams
        ]
        found.append([(type(one).__name__, wait) for one, wait in zip(streams, waits, strict=True)])

    side.relay._reactor.call(look)
    return wait_until(lambda: found, "a look at the connections", 5)[0]


def test_two_gateways_have_one_link_a_topic_however_many_subscribe(sides):
    source, sink = sides
    connect(source, sink, ("/chatter", "/big"))
    with contextlib.ExitStack() as stack:
        topics = ("/chatter", "/chatter", "/chatter", "/big")
        subscribers = [
            stack.enter_context(Subscriber(sink, "/source/talker1", topic)) for topic in topics
        ]
        assert all(number_of_good(one) >= 0 for one in subscribers)
        assert connections_to(source.relay.port) == 2
        sink.relay.apply(
            set(), {one for one in sink.relay.status().imports if one.topic == "/chatter"}
        )
        wait_until(
            lambda: connections_to(source.relay.port) == 1,
            "the link of the other topic is closed",
            5,
        )
        assert all(number_of_good(one) >= 0 for one in subscribers[:3])


def test_nothing_that_messages_cross_on_waits_for_nagle(sides):
    source, sink = sides
    connect(source, sink)
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
        assert number_of_good(subscriber) >= 0
        found = waits_for_nagle(source) + waits_for_nagle(sink)
        assert {"ExportEnd", "_Publisher", "TopicLink", "NodeConnection"} <= {
            kind for kind, _ in found
        }
        assert not any(waits for _, waits in found)
