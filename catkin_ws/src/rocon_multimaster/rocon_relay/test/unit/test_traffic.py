import pytest

from rocon_relay.connection import LinkState, LinkStatus
from rocon_relay.latency import RoundTrips
from rocon_relay.link import seconds_from_field
from rocon_relay.traffic import Traffic


def link(messages, size):
    return LinkStatus(LinkState.ACTIVE, messages=messages, bytes=size)


def test_rates_are_what_came_since_the_last_look():
    traffic = Traffic()
    assert traffic.look(10.0, {"a": link(100, 1000)})["a"].messages == 0.0
    flow = traffic.look(12.0, {"a": link(150, 3000), "b": link(7, 7)})
    assert (flow["a"].messages, flow["a"].bytes) == (25.0, 1000.0)
    assert flow["b"].messages == 0.0


def test_a_connection_that_counts_again_has_no_negative_rate():
    traffic = Traffic()
    traffic.look(1.0, {"a": link(100, 1000)})
    assert traffic.look(2.0, {"a": link(3, 30)})["a"].messages == 0.0


def test_the_newest_five_round_trips_count():
    trips = RoundTrips()
    assert trips.latency() is None
    for seconds in (9.0, 0.1, 0.2, 0.3, 0.2, 0.2):
        trips.add(seconds)
    latency = trips.latency()
    assert (latency.shortest, latency.longest, trips.last) == (0.1, 0.3, 0.2)
    assert latency.mean == pytest.approx(0.2)
    assert latency.deviation == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("text", "seconds"), [("0.25", 0.25), ("", 0), ("nan", 0), ("-1", 0), ("inf", 0), ("x", 0)]
)
def test_what_others_measured_counts_only_if_it_can_be(text, seconds):
    assert seconds_from_field(text) == seconds
