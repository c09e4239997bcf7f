"""A silent link whose bytes are all acknowledged: a middlebox that swallows data, or a frozen relay."""

import dataclasses
import time

import pytest
from relay_side import Subscriber, connect, export, imported, wait_for
from tcp_proxy import TcpProxy

from pioneer_harness.wait import wait_until
from rocon_relay.connection import Address, LinkState

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.fixture
def middlebox(relays, talkers):
    """Two relays that connect through a proxy."""
    source, sink = relays("source"), relays("sink")
    proxy = TcpProxy("127.0.0.1", source.relay.port)
    yield source, sink, proxy
    proxy.close()


@pytest.mark.parametrize("flowing", [True, False], ids=["messages flow", "idle"])
def test_a_black_holed_link_is_noticed_within_10_s_and_reconnects(
    middlebox, flowing, record_property
):
    source, sink, proxy = middlebox
    wanted = dataclasses.replace(imported(source), address=Address("127.0.0.1", proxy.port))
    source.relay.apply({export()}, set())
    sink.relay.apply(set(), {wanted})
    wait_for(sink, LinkState.ACTIVE)
    subscriber = Subscriber(sink, "/source/talker1", "/chatter") if flowing else None
    if subscriber:
        assert subscriber.text_of_message()
    proxy.swallows = True
    cut = time.monotonic()
    wait_until(lambda: not sink.publishers("/chatter"), "the proxy node is unregistered", 12)
    noticed = time.monotonic() - cut
    record_property("swallowed link noticed", round(noticed, 2))
    assert noticed <= 10.0
    assert "nothing has come for" in sink.link().reason or sink.state() == [LinkState.UNREACHABLE]
    proxy.swallows = False
    wait_for(sink, LinkState.ACTIVE, 10)
    if subscriber:
        assert subscriber.is_ended(5)
        subscriber.close()


def test_an_idle_link_whose_far_end_answers_stays(relays, talkers, record_property):
    # Long enough that an end that waits for CPU time is not taken for a dead one.
    source, sink = relays("source", silence=1.5), relays("sink", silence=1.5)
    connect(source, sink)
    (end,) = sink.relay._imports.values()
    link, began = end._link, time.monotonic()
    wait_until(lambda: time.monotonic() - began > 4.6, "three times the silence that is allowed", 6)
    assert end._link is link
    assert link.received() > 0
    assert sink.state() == [LinkState.ACTIVE]
