"""How much peers and unauthenticated clients may use of a relay, and what it measures of them."""

import contextlib
import socket

import pytest
from relay_side import Subscriber, connect, export, imported, node_at, number_of_good, wait_for

from pioneer_harness.wait import wait_until
from rocon_relay.connection import LinkState

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


def test_a_peer_may_have_so_many_links_and_gets_the_reason(relays, talkers):
    source, sink = relays("source", max_links=2), relays("sink")
    topics = ("/chatter", "/big", "/latched")
    source.relay.apply({export(topic) for topic in topics}, set())
    sink.relay.apply(set(), {imported(source, topic) for topic in topics})
    wait_until(lambda: sorted(sink.state()) == ["active", "active", "refused"], "two of three", 5)
    (refused,) = [
        link for link in sink.relay.status().imports.values() if link.state is LinkState.REFUSED
    ]
    assert "sink has 2 links open here, and may have no more" in refused.reason
    sink.relay.apply(set(), {imported(source, topic) for topic in topics[1:]})
    wait_for(sink, LinkState.ACTIVE)


def test_a_flood_of_connections_keeps_no_subscriber_out(sides):
    source, sink = sides
    connect(source, sink)
    with node_at(sink.master.proxy().lookupNode("/source/talker1")) as slave:
        _, _, (_, host, port) = slave.requestTopic("/t", "/chatter", [["TCPROS"]])
    with contextlib.ExitStack() as stack:
        first = stack.enter_context(socket.create_connection((host, port), timeout=5))
        for target in (port, source.relay.port):
            for _ in range(300):
                stack.enter_context(socket.create_connection((host, target), timeout=5))
        assert first.recv(1) == b"", "the oldest has made room"
        with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
            assert number_of_good(subscriber) >= 0


@pytest.mark.parametrize("topic", ["/chatter", "/mixed"])
def test_both_ends_know_how_long_the_way_takes_and_messages_are_not_disturbed(
    relays, talkers, topic
):
    source, sink = relays("source"), relays("sink", ping_period=0.01)
    connect(source, sink, (topic,))
    with Subscriber(sink, "/source/talker1", topic) as subscriber:
        numbers = [number_of_good(subscriber) for _ in range(30)]
        step = numbers[1] - numbers[0]
        assert numbers == list(range(numbers[0], numbers[0] + 30 * step, step))
        wait_until(
            lambda: "sink" in source.relay.status().latencies, "what the sink has measured", 5
        )
        latency = sink.relay.status().latencies["source"]
    assert 0 < latency.shortest <= latency.mean <= latency.longest < 5
    sink.relay.apply(set(), set())
    wait_until(
        lambda: not sink.relay.status().latencies and not source.link().subscribers,
        "all forgotten",
        5,
    )
