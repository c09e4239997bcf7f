"""Messages that cross two relays between two real masters, with real nodes."""

import errno
import os
import subprocess
import xmlrpc.client

import pytest
from relay_side import (
    STRING,
    STRING_MD5,
    Subscriber,
    connect,
    lines,
    listener,
    node_at,
    number_of_good,
    subscribers_of_talker,
)
from tf2_msgs.msg import TFMessage

from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until
from rocon_relay.connection import LinkState, is_proxy_uri
from tcpros.pipe import Pipe

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.mark.parametrize("topic", ["/chatter", "/big"])
def test_messages_reach_a_rospy_subscriber_unchanged_and_stop_after_the_cancel(
    sides, topic, tmp_path
):
    source, sink = sides
    connect(source, sink, (topic,))
    with ProcessGroup() as group:
        listener(group, sink, topic, tmp_path / "log")
        wait_until(lambda: len(lines(tmp_path / "log")) > 10, "messages", START)
        sink.relay.apply(set(), set())
        wait_until(lambda: not sink.publishers(topic), "no registration", 2)
        wait_until(lambda: not subscribers_of_talker(source.master, topic), "no subscription", 1)
        last = lines(tmp_path / "log")
    assert all(line.endswith("good") for line in last)
    numbers = [int(line.split()[0]) for line in last]
    assert numbers == list(range(numbers[0], numbers[-1] + 1, numbers[1] - numbers[0]))


def test_a_roscpp_node_subscribes(sides, tmp_path):
    source, sink = sides
    connect(source, sink)
    with ProcessGroup() as group:
        argv = ["/usr/lib/topic_tools/relay", "/chatter", "/copy", "__name:=copier"]
        listener(group, sink, "", tmp_path / "relay", argv)
        wait_until(lambda: sink.publishers("/copy"), "roscpp's relay knows the type", START)
        with Subscriber(sink, "/copier", "/copy", type_=STRING, md5sum=STRING_MD5) as copy:
            # The node's own queue holds ten messages (0.1 s); messages dropped there are not the relay's fault.
            assert number_of_good(copy) < number_of_good(copy)


def test_the_proxy_answers_as_a_node(sides):
    source, sink = sides
    connect(source, sink)
    environment = sink.master.environment
    ping = subprocess.run(
        ["/usr/bin/rosnode", "ping", "-c", "1", "/source/talker1"],
        env=environment,
        capture_output=True,
        text=True,
    )
    assert "xmlrpc reply" in ping.stdout, ping.stdout + ping.stderr
    with (
        Subscriber(sink, "/source/talker1", "/chatter") as subscriber,
        node_at(subscriber.uri) as slave,
    ):
        assert is_proxy_uri(subscriber.uri)
        assert slave.getPublications("/t")[2] == [["/chatter", STRING]]
        assert slave.getSubscriptions("/t")[:1] == [1]
        assert slave.getMasterUri("/t")[2] == sink.master.uri
        assert slave.getPid("/t")[0] == 1
        assert slave.getBusStats("/t")[0] == 1
        assert [row[1:5] for row in slave.getBusInfo("/t")[2]] == [
            ["/tester", "o", "TCPROS", "/chatter"]
        ]
        assert slave.paramUpdate("/t", "/key", 1)[0] == 1
        assert slave.publisherUpdate("/t", "/chatter", [])[0] == 1
        assert slave.shutdown("/t", "no reason")[0] == 0
        assert slave.getPid("/t", "too", "many")[0] == -1
        assert slave.requestTopic("/t", "/other", [["TCPROS"]])[0] == 0
        assert slave.requestTopic("/t", "/chatter", [["UDPROS"]])[0] == 0
        with pytest.raises(xmlrpc.client.Fault):
            slave.nonsense()
        assert int(subscriber.text_of_message()[:8]) >= 0


def test_a_proxy_that_rosnode_should_kill_stays_and_the_log_says_why(sides, caplog):
    """`rosnode kill` prints "killed" whatever a node answers, so only the gateway can tell."""
    source, sink = sides
    connect(source, sink)
    killed = subprocess.run(
        ["/usr/bin/rosnode", "kill", "/source/talker1"],
        env=sink.master.environment,
        capture_output=True,
        text=True,
    )
    assert killed.returncode == 0, killed.stdout + killed.stderr
    assert (
        "/source/talker1 is shown by a gateway; take back its rule there to end it" in caplog.text
    )
    assert sink.publishers("/chatter") == ["/source/talker1"]


def test_newcomers_get_the_last_latched_message_of_each_source(sides):
    source, sink = sides
    connect(source, sink, ("/latched",), ("/talker1", "/talker2"))
    for _ in range(2):  # the second subscriber of each connects while the first is served
        for name in ("talker1", "talker2"):
            with (
                Subscriber(sink, f"/source/{name}", "/latched") as first,
                Subscriber(sink, f"/source/{name}", "/latched", "/other") as second,
            ):
                assert first.header["latching"] == "1"
                assert first.header["callerid"] == f"/source/{name}"
                assert first.header["md5sum"] == STRING_MD5
                assert "string data" in first.header["message_definition"]
                assert first.text_of_message() == f"last of {name}"
                assert second.text_of_message() == f"last of {name}"


def test_newcomers_get_the_frames_of_all_latched_publishers_in_one_node(sides):
    source, sink = sides
    connect(
        source, sink, ("/tf_latched",), at_source={"type_": TFMessage._type}, type_=TFMessage._type
    )
    with Subscriber(sink, "/source/talker1", "/tf_latched") as first:
        assert [poses(first) for _ in range(6)][4:] == [("left", 2.0), ("right", 2.0)]
        with Subscriber(sink, "/source/talker1", "/tf_latched", "/other") as second:
            assert [poses(second) for _ in range(2)] == [("left", 2.0), ("right", 2.0)]


def poses(subscriber):
    """Returns child frame and x of the only transform in the next message."""
    (one,) = TFMessage().deserialize(subscriber.bytes()).transforms
    return one.child_frame_id, one.transform.translation.x


def test_a_topic_is_subscribed_at_its_source_only_while_somebody_listens(sides):
    source, sink = sides
    # The talker notices a closed connection only when it publishes the next message.
    wait_until(lambda: not subscribers_of_talker(source.master), "those of other tests are gone", 5)
    connect(source, sink)
    assert subscribers_of_talker(source.master) == []
    with (
        Subscriber(sink, "/source/talker1", "/chatter") as one,
        Subscriber(sink, "/source/talker1", "/chatter") as two,
    ):
        assert one.text_of_message()
        assert two.text_of_message()
        assert subscribers_of_talker(source.master) == ["/gateway_source"]
        assert sink.link().subscribers == 2
        assert source.link().subscribers == 1
    wait_until(lambda: not subscribers_of_talker(source.master), "no subscription", 2)
    with Subscriber(sink, "/source/talker1", "/chatter") as again:
        assert again.text_of_message()


def test_a_large_topic_can_be_left_and_joined_again_within_a_message(sides):
    source, sink = sides
    connect(source, sink, ("/big",))
    for _ in range(20):
        with Subscriber(sink, "/source/talker1", "/big") as subscriber:
            assert len(subscriber.text_of_message()) == 700_000
    assert sink.link().state is LinkState.ACTIVE


def test_large_and_small_messages_pass_unchanged_whoever_joins_and_leaves_between(
    sides, monkeypatch
):
    source, sink = sides
    unseen = []
    move = Pipe.move

    def counting_move(*arguments):
        moved = move(*arguments)
        unseen.append(moved.taken)
        return moved

    monkeypatch.setattr(Pipe, "move", counting_move)
    connect(source, sink, ("/mixed",))
    with Subscriber(sink, "/source/talker1", "/mixed") as steady:
        numbers = [number_of_good(steady) for _ in range(8)]
        for _ in range(5):
            with Subscriber(sink, "/source/talker1", "/mixed", "/passing") as passing:
                first = number_of_good(passing)
                assert number_of_good(passing) == first + 10
                numbers.append(number_of_good(steady))
        numbers += [number_of_good(steady) for _ in range(20)]
    assert numbers == list(range(numbers[0], numbers[0] + 10 * len(numbers), 10))
    assert sum(unseen) > 5_000_000
    link = sink.link()
    assert (link.messages >= len(numbers), link.drops) == (True, 0)


def test_a_kernel_that_cannot_splice_costs_nothing_but_time(sides, monkeypatch):
    def refuse(*_, **__):
        raise OSError(errno.EINVAL, "Invalid argument")

    source, sink = sides
    monkeypatch.setattr(os, "splice", refuse)
    connect(source, sink, ("/mixed",))
    with Subscriber(sink, "/source/talker1", "/mixed") as subscriber:
        numbers = [number_of_good(subscriber) for _ in range(20)]
    assert numbers == list(range(numbers[0], numbers[0] + 200, 10))


def test_a_stalled_subscriber_loses_the_oldest_and_slows_nobody(relays, talkers):
    source, sink = relays("source"), relays("sink", queue_bytes=2_000_000)
    connect(source, sink, ("/big",))
    with (
        Subscriber(sink, "/source/talker1", "/big", receive_buffer=4096) as stalled,
        Subscriber(sink, "/source/talker1", "/big") as quick,
    ):
        numbers = []
        while not numbers or sink.link().drops < 10:
            numbers.append(int(quick.text_of_message()[:8]))
        assert numbers == list(range(numbers[0], numbers[-1] + 10, 10))
        got = [int(stalled.text_of_message()[:8]) for _ in range(8)]
    assert got == sorted(set(got))
    assert got[-1] > got[0] + 70, "some were dropped in between"
