"""Per-link options of rules, applied at the source: real publishers, two relays, real sockets."""

import time

import pytest
from relay_side import Subscriber, connect, number_of_good, wait_for
from tf2_msgs.msg import TFMessage

from pioneer_harness.wait import wait_until
from rocon_relay.connection import LinkState
from rocon_relay.option import LinkOptions

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

TF = "tf2_msgs/TFMessage"


@pytest.mark.parametrize("at", ["the source", "the sink"])
def test_a_rate_lets_the_newest_messages_cross_whichever_end_asks_for_it(sides, at):
    source, sink = sides
    options = LinkOptions(rate=10.0)
    asked = {"at_source": {"options": options}} if at == "the source" else {"options": options}
    connect(source, sink, state=LinkState.RATE_LIMITED, **asked)
    assert sink.link().reason == source.link().reason == "at most 10 messages a second"
    begin = time.monotonic()
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
        numbers = [number_of_good(subscriber) for _ in range(6)]
        wait_until(lambda: source.link().left_out > 3, "messages that do not cross", 5)
        link = source.link()
        assert 6 <= link.messages <= 10 * (time.monotonic() - begin) + 1
    assert numbers == sorted(set(numbers))
    assert link.drops == 0


def test_the_strictest_of_both_ends_counts(sides):
    source, sink = sides
    mine, yours = LinkOptions(rate=20.0), LinkOptions(rate=5.0)
    connect(source, sink, state=LinkState.RATE_LIMITED, at_source={"options": mine}, options=yours)
    assert sink.link().reason == "at most 5 messages a second"


def test_the_last_message_of_each_frame_crosses_when_a_stream_pauses_whatever_its_stamp(sides):
    """All messages of this stream have the same stamp, so only the first of each frame is due."""
    source, sink = sides
    wanted = {"type_": TF, "options": LinkOptions(stamp_rate=20.0)}
    connect(source, sink, ("/tf_burst",), at_source={"type_": TF}, **wanted)
    with Subscriber(sink, "/source/talker1", "/tf_burst") as subscriber:
        came = [TFMessage().deserialize(subscriber.bytes()).transforms[0] for _ in range(4)]
    found = [(one.child_frame_id, one.transform.translation.x) for one in came]
    assert found == [("left", 0), ("right", 0), ("left", 2), ("right", 2)]
    assert source.link().left_out == 2


@pytest.mark.parametrize("topic", ["/chatter", "/big", "/mixed"])
def test_compressed_messages_arrive_as_they_were_sent(sides, topic):
    source, sink = sides
    connect(source, sink, (topic,), options=LinkOptions(compress=True))
    with Subscriber(sink, "/source/talker1", topic) as subscriber:
        step = 1 if topic == "/chatter" else 10
        numbers = [number_of_good(subscriber) for _ in range(8)]
    assert numbers == list(range(numbers[0], numbers[0] + 8 * step, step))
    here, there = sink.link(), source.link()
    assert there.saved > 0.3 * there.bytes if topic != "/chatter" else there.saved != 0
    assert here.bytes >= sum(len(str(number)) for number in numbers)
    assert here.saved <= there.saved or topic == "/chatter"


def test_a_latched_message_comes_compressed_too(sides):
    source, sink = sides
    connect(source, sink, ("/latched",), options=LinkOptions(compress=True))
    for _ in range(2):
        with Subscriber(sink, "/source/talker1", "/latched") as subscriber:
            assert subscriber.text_of_message() == "last of talker1"


def test_only_transforms_cross_whose_child_frame_matches(sides):
    source, sink = sides
    wanted = {"type_": TF, "options": LinkOptions(tf_frames=("pioneer2/.*",))}
    connect(source, sink, ("/tf_static",), at_source={"type_": TF}, **wanted)
    for _ in range(2):
        with Subscriber(sink, "/source/talker1", "/tf_static") as subscriber:
            message = TFMessage().deserialize(subscriber.bytes())
            assert [one.child_frame_id for one in message.transforms] == ["pioneer2/laser"]


def test_a_transform_that_nobody_wants_does_not_cross(sides):
    source, sink = sides
    wanted = {"type_": TF, "options": LinkOptions(tf_frames=("pioneer3/.*",))}
    connect(source, sink, ("/tf_static",), at_source={"type_": TF}, **wanted)
    with Subscriber(sink, "/source/talker1", "/tf_static"):
        wait_until(lambda: source.link().left_out == 1, "the message is looked at", 5)
    assert sink.link().messages == source.link().messages == 0


def test_a_queue_drops_the_oldest_at_the_source_where_the_link_is_slow(sides):
    source, sink = sides
    connect(source, sink, ("/flood",), options=LinkOptions(queue_size=1))
    with Subscriber(sink, "/source/talker1", "/flood", receive_buffer=4096) as slow:
        first = number_of_flood(slow)
        # Drops end after a second or two, when the sink stops waiting for the slow reader; the pace sets their number.
        wait_until(lambda: source.link().drops > 3, "drops at the source", 10)
        late = [number_of_flood(slow) for _ in range(60)]
    assert late == sorted(set(late))
    assert late[0] > first
    assert late[-1] - late[0] > 60


def test_a_remote_pattern_not_matched_in_linear_time_is_refused(sides):
    source, sink = sides
    options = LinkOptions(tf_frames=(r"(a+)\1b",))
    wanted = {"type_": TF, "options": options}
    connect(
        source, sink, ("/tf_static",), at_source={"type_": TF}, state=LinkState.REFUSED, **wanted
    )
    assert "no back-references" in sink.link().reason
    assert not sink.publishers("/tf_static")


def test_options_that_change_have_the_link_dialled_again(sides):
    source, sink = sides
    connect(source, sink)
    connect(source, sink, state=LinkState.RATE_LIMITED, options=LinkOptions(rate=3.0))
    wait_for(source, LinkState.RATE_LIMITED)
    connect(source, sink)


def number_of_flood(subscriber):
    return int(subscriber.text_of_message()[:8])
