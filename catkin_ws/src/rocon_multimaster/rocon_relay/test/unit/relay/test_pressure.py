"""Slow subscribers, and what they slow down: real publishers, two relays, subscribers that read at their own pace."""

import time

import pytest
from relay_side import Subscriber, connect

from pioneer_harness.wait import wait_until
from rocon_relay.connection import LinkState

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

RESTS = 0.05
"""Between two messages of a subscriber that is slower than its publisher [s]."""


def number(subscriber):
    return int(subscriber.text_of_message()[:8])


def test_a_slow_subscriber_slows_its_publisher_and_loses_nothing(sides):
    source, sink = sides
    connect(source, sink, ("/flood",))
    with Subscriber(sink, "/source/talker1", "/flood", receive_buffer=65536) as slow:
        got = [number(slow)]
        for _ in range(30):
            time.sleep(RESTS)  # time to process the message
            got.append(number(slow))
        got += [number(slow) for _ in range(100)]
    assert got == list(range(got[0], got[0] + len(got)))
    assert sink.link().drops == source.link().drops == 0


def test_a_subscriber_that_stands_still_stops_neither_the_link_nor_others(sides):
    source, sink = sides
    connect(source, sink, ("/flood",))
    with Subscriber(sink, "/source/talker1", "/flood", receive_buffer=4096) as still:
        first = number(still)
        wait_until(lambda: sink.link().drops > 20, "what it does not take is dropped", 10)
        with Subscriber(sink, "/source/talker1", "/flood", "/other") as other:
            # While no subscriber was reading, the source may have dropped some of the messages in transit.
            lost_before = source.link().drops
            got = [number(other) for _ in range(100)]
        assert got == sorted(set(got))
        assert got[-1] - got[0] + 1 - len(got) <= lost_before
        assert got[0] > first + 20
        assert sink.link().state is LinkState.ACTIVE
        late = [number(still) for _ in range(60)]
    assert late == sorted(set(late)), "whole messages, in order"
    assert late[-1] > got[0]


def test_a_subscriber_that_takes_a_little_at_a_time_does_not_make_its_link_look_dead(sides):
    source, sink = sides
    connect(source, sink, ("/flood",))
    with Subscriber(sink, "/source/talker1", "/flood", receive_buffer=4096) as slow:
        end = time.monotonic() + 10  # a link that is not read for 7 s is given up
        while time.monotonic() < end:
            time.sleep(RESTS)
            assert slow.socket.recv(500)
            assert sink.link().subscribers == 1
    assert sink.link().state is LinkState.ACTIVE
