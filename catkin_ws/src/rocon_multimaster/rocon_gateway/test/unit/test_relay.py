"""Two relays between two real masters, with real nodes."""

import contextlib
import errno
import hashlib
import itertools
import logging
import os
import random
import re
import socket
import struct
import subprocess
import sys
import threading
import time
import xmlrpc.client
from pathlib import Path

import pytest

from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until
from rocon_gateway.adapters.relay.pipe import Pipe
from rocon_gateway.adapters.relay.relay import TcpRelay
from rocon_gateway.core.connection import (
    ANY,
    Address,
    ConnectionConflictError,
    Export,
    Import,
    LinkOptions,
    LinkState,
    RelayConfig,
    is_proxy_uri,
)
from rocon_gateway.core.header import header_bytes, header_fields

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

NODES = Path(__file__).parent.parent / "node"
STRING = "std_msgs/String"
STRING_MD5 = "992ce8a1687cec8c8bd883ec73ca41d1"


class Side:
    """A master with its relay."""

    def __init__(self, name, master, **settings):
        self.name = name
        self.master = master
        self.changes = threading.Event()
        config = RelayConfig(name, f"/gateway_{name}", master.uri, "127.0.0.1", **settings)
        self.relay = TcpRelay(config, self.changes.set, logging.getLogger(f"relay.{name}"))

    @property
    def address(self):
        return Address("127.0.0.1", self.relay.port)

    def state(self):
        """The states of all imports and exports."""
        status = self.relay.status()
        return [link.state for link in (*status.imports.values(), *status.exports.values())]

    def link(self):
        """The status of the one import or export."""
        status = self.relay.status()
        (link,) = (*status.imports.values(), *status.exports.values())
        return link

    def publishers(self, topic):
        return self.master.system_state()[0].get(topic, [])


class Subscriber:
    """A TCPROS subscriber of one publisher, written anew so that no ROS code hides a fault."""

    def __init__(self, side, node, topic, name="/tester", type_=ANY, md5sum=ANY, receive_buffer=None):
        self.uri = side.master.proxy().lookupNode(node)
        self.socket = None
        with node_at(self.uri) as slave:
            status, self.text, answer = slave.requestTopic(name, topic, [["TCPROS"]])
        self.header = None
        if status != 1:
            return
        self.socket = socket.socket()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(5)
        self.socket.connect((answer[1], answer[2]))
        fields = {"callerid": name, "topic": topic, "type": type_, "md5sum": md5sum, "tcp_nodelay": "1"}
        self.socket.sendall(header_bytes(fields))
        self.header = header_fields(self.bytes())

    def bytes(self):
        """The next length and what follows; b"" at the end."""
        length = self._exactly(4)
        return self._exactly(struct.unpack("<I", length)[0]) if length else b""

    def text_of_message(self):
        """The next std_msgs/String."""
        return self.bytes()[4:].decode()

    def is_ended(self, within):
        """Whether the connection ends so soon, whatever comes before."""
        self.socket.settimeout(within)
        deadline = time.monotonic() + within
        try:
            while time.monotonic() < deadline:
                if not self.socket.recv(65536):
                    return True
        except ConnectionError:
            return True
        except TimeoutError:
            return False
        return False

    def close(self):
        if self.socket is not None:
            self.socket.close()

    def _exactly(self, size):
        data = b""
        while len(data) < size:
            more = self.socket.recv(size - len(data))
            if not more:
                return b""
            data += more
        return data

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


@contextlib.contextmanager
def node_at(uri):
    with xmlrpc.client.ServerProxy(uri) as slave:
        yield slave


@pytest.fixture(scope="module")
def source_master():
    with Master() as master:
        yield master


@pytest.fixture(scope="module")
def sink_master():
    with Master() as master:
        yield master


@pytest.fixture(scope="module")
def talkers(source_master, tmp_path_factory):
    """Two talkers on the source's master."""
    logs = tmp_path_factory.mktemp("talkers")
    with ProcessGroup() as group:
        for name in ("talker1", "talker2"):
            argv = [sys.executable, str(NODES / "talker.py"), "last", "of", name, f"__name:={name}"]
            group.start(name, argv, source_master.environment, logs / name)
        wait_until(lambda: len(source_master.system_state()[0].get("/latched", [])) == 2, "two talkers", 15)
        yield group


@pytest.fixture
def relays(source_master, sink_master):
    """Makes relays, and ends them."""
    made = []

    def make(name, **settings):
        made.append(Side(name, source_master if name == "source" else sink_master, **settings))
        return made[-1]

    yield make
    for side in made:
        side.relay.shutdown()
    assert not [name for name in sink_master.system_state()[0].values() if any(n.startswith("/source/") for n in name)]


@pytest.fixture
def sides(relays, talkers):
    """A source and a sink, nothing asked of them yet."""
    return relays("source"), relays("sink")


def export(topic="/chatter", node="/talker1", type_=STRING):
    return Export(topic, type_, node, "sink")


def imported(source, topic="/chatter", node="/talker1", type_=STRING, md5sum=ANY, allowed="", options=None):
    return Import(topic, type_, md5sum, "source", node, source.address, allowed, options or LinkOptions())


def connect(source, sink, topics=("/chatter",), nodes=("/talker1",), **more):
    pairs = list(itertools.product(topics, nodes))
    source.relay.apply({export(*pair) for pair in pairs}, set())
    sink.relay.apply(set(), {imported(source, *pair, **more) for pair in pairs})
    wait_for(sink, LinkState.ACTIVE)


def wait_for(side, state, timeout=5):
    wait_until(lambda: side.state() and all(s is state for s in side.state()), f"{side.name} {state}", timeout)


def number_of_good(subscriber):
    """The number of the next message, whose text must be as it was sent."""
    text = subscriber.text_of_message()
    whole = hashlib.sha256(str(int(text[:8])).encode()).hexdigest() * (len(text) // 64 + 1)
    assert whole.startswith(text[8:])
    return int(text[:8])


def subscribers_of_talker(master, topic="/chatter", node="/talker1"):
    with node_at(master.proxy().lookupNode(node)) as slave:
        return [row[1] for row in slave.getBusInfo("/tester")[2] if row[4] == topic]


def listener(group, side, topic, log, argv=None):
    group.start("listener", argv or [sys.executable, str(NODES / "listener.py"), topic], side.master.environment, log)


def lines(path):
    return path.read_text().splitlines() if path.exists() else []


@pytest.mark.parametrize("topic", ["/chatter", "/big"])
def test_messages_reach_a_rospy_subscriber_unchanged_and_stop_after_the_cancel(sides, topic, tmp_path):
    source, sink = sides
    connect(source, sink, (topic,))
    with ProcessGroup() as group:
        listener(group, sink, topic, tmp_path / "log")
        wait_until(lambda: len(lines(tmp_path / "log")) > 10, "messages", 15)
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
        wait_until(lambda: sink.publishers("/copy"), "roscpp's relay knows the type", 10)
        with Subscriber(sink, "/copier", "/copy", type_=STRING, md5sum=STRING_MD5) as copy:
            first = int(copy.text_of_message()[:8])
            assert int(copy.text_of_message()[:8]) == first + 1


def test_the_proxy_answers_as_a_node(sides):
    source, sink = sides
    connect(source, sink)
    environment = sink.master.environment
    ping = subprocess.run(
        ["/usr/bin/rosnode", "ping", "-c", "1", "/source/talker1"], env=environment, capture_output=True, text=True
    )
    assert "xmlrpc reply" in ping.stdout, ping.stdout + ping.stderr
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber, node_at(subscriber.uri) as slave:
        assert is_proxy_uri(subscriber.uri)
        assert slave.getPublications("/t")[2] == [["/chatter", STRING]]
        assert slave.getSubscriptions("/t")[:1] == [1]
        assert slave.getMasterUri("/t")[2] == sink.master.uri
        assert slave.getPid("/t")[0] == 1
        assert slave.getBusStats("/t")[0] == 1
        assert [row[1:5] for row in slave.getBusInfo("/t")[2]] == [["/tester", "o", "TCPROS", "/chatter"]]
        assert slave.paramUpdate("/t", "/key", 1)[0] == 1
        assert slave.publisherUpdate("/t", "/chatter", [])[0] == 1
        assert slave.shutdown("/t", "no reason")[0] == 0
        assert slave.getPid("/t", "too", "many")[0] == -1
        assert slave.requestTopic("/t", "/other", [["TCPROS"]])[0] == 0
        assert slave.requestTopic("/t", "/chatter", [["UDPROS"]])[0] == 0
        with pytest.raises(xmlrpc.client.Fault):
            slave.nonsense()
        assert int(subscriber.text_of_message()[:8]) >= 0


def test_newcomers_get_the_last_latched_message_of_each_source(sides):
    source, sink = sides
    connect(source, sink, ("/latched",), ("/talker1", "/talker2"))
    for _ in range(2):  # the second subscriber of each comes while the first is served
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


def test_a_topic_is_subscribed_at_its_source_only_while_somebody_listens(sides):
    source, sink = sides
    connect(source, sink)
    assert subscribers_of_talker(source.master) == []
    with Subscriber(sink, "/source/talker1", "/chatter") as one, Subscriber(sink, "/source/talker1", "/chatter") as two:
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


def test_large_and_small_messages_pass_unchanged_whoever_joins_and_leaves_between(sides, monkeypatch):
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


def test_only_allowed_nodes_may_subscribe(sides):
    source, sink = sides
    connect(source, sink, allowed="/good.*")
    with Subscriber(sink, "/source/talker1", "/chatter", "/bad") as bad:
        assert bad.header is None
        assert "/good.*" in bad.text
    with Subscriber(sink, "/source/talker1", "/chatter", "/good1") as good:
        assert good.text_of_message()
        sink.relay.apply(set(), {imported(source, allowed="/better")})
        assert good.is_ended(1)
        assert sink.link().state is LinkState.ACTIVE


def test_a_subscriber_of_another_type_is_told_so(sides):
    source, sink = sides
    connect(source, sink)
    with Subscriber(sink, "/source/talker1", "/chatter", type_="std_msgs/Bool", md5sum="0" * 32) as subscriber:
        assert "std_msgs/Bool" in subscriber.header["error"]
    with Subscriber(sink, "/source/talker1", "/chatter", type_=STRING, md5sum="0" * 32) as subscriber:
        assert "MD5" in subscriber.header["error"]
    assert sink.link().state is LinkState.ACTIVE


def test_a_type_or_definition_that_differs_is_a_state(sides):
    source, sink = sides
    source.relay.apply({export()}, set())
    sink.relay.apply(set(), {imported(source, type_="std_msgs/Bool")})
    wait_for(sink, LinkState.TYPE_MISMATCH)
    assert not sink.publishers("/chatter")
    sink.relay.apply(set(), {imported(source, md5sum="0" * 32)})
    wait_for(sink, LinkState.ACTIVE)
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
        assert subscriber.header == {}
    wait_for(sink, LinkState.TYPE_MISMATCH)
    wait_until(lambda: not sink.publishers("/chatter"), "no registration", 2)


def test_a_missing_publisher_is_a_state(sides):
    source, sink = sides
    source.relay.apply({export(node="/nobody")}, set())
    sink.relay.apply(set(), {imported(source, node="/nobody")})
    wait_for(sink, LinkState.ACTIVE)
    uri = sink.master.proxy().lookupNode("/source/nobody")
    with node_at(uri) as slave:
        _, _, (_, host, port) = slave.requestTopic("/t", "/chatter", [["TCPROS"]])
    with socket.create_connection((host, port)) as waiting:
        waiting.sendall(header_bytes({"callerid": "/t", "topic": "/chatter", "type": ANY, "md5sum": ANY}))
        wait_for(sink, LinkState.NO_PUBLISHER)
        assert "/nobody" in sink.link().reason


def test_an_export_may_come_later_than_the_question_for_it(sides):
    source, sink = sides
    sink.relay.apply(set(), {imported(source)})
    source.relay.apply({export()}, set())
    wait_for(sink, LinkState.ACTIVE, 1)


def test_what_is_not_exported_is_refused(relays, talkers):
    source, sink = relays("source", patience=0.05), relays("sink")
    sink.relay.apply(set(), {imported(source)})
    wait_for(sink, LinkState.REFUSED)
    assert "exports no publisher /talker1 of /chatter" in sink.link().reason
    assert not sink.publishers("/chatter")


def test_a_gateway_that_dies_is_noticed_and_found_again(relays, talkers):
    source, sink = relays("source"), relays("sink")
    connect(source, sink)
    port = source.relay.port
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
        assert subscriber.text_of_message()
        source.relay.shutdown()
        wait_until(lambda: not sink.publishers("/chatter"), "no registration", 3)
        assert subscriber.is_ended(1)
    wait_for(sink, LinkState.UNREACHABLE)
    back = relays("source", port=port)
    back.relay.apply({export()}, set())
    wait_for(sink, LinkState.ACTIVE, 4)
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
        assert subscriber.text_of_message()


def test_a_moved_relay_is_dialled_at_its_new_address(relays, talkers):
    source, sink = relays("source"), relays("sink")
    connect(source, sink)
    other = relays("source")
    other.relay.apply({export()}, set())
    sink.relay.apply(set(), {imported(other)})
    wait_until(lambda: other.state() == [LinkState.ACTIVE], "the other relay is dialled", 3)
    wait_for(sink, LinkState.ACTIVE)


def test_a_restarted_publisher_flows_again(sides, tmp_path):
    source, sink = sides
    argv = [sys.executable, str(NODES / "talker.py"), "__name:=mortal"]
    with ProcessGroup() as group:
        group.start("mortal", argv, source.master.environment, tmp_path / "first")
        wait_until(lambda: "/mortal" in source.publishers("/latched"), "the publisher", 10)
        connect(source, sink, nodes=("/mortal",))
        subscriber = Subscriber(sink, "/source/mortal", "/chatter")
        assert subscriber.text_of_message()
    wait_for(sink, LinkState.NO_PUBLISHER)
    with ProcessGroup() as group, subscriber:
        group.start("mortal", argv, source.master.environment, tmp_path / "second")
        wait_for(sink, LinkState.ACTIVE, 15)
        assert subscriber.text_of_message()


def test_a_master_that_has_forgotten_is_told_again(sides):
    source, sink = sides
    connect(source, sink)
    uri = sink.master.proxy().lookupNode("/source/talker1")
    sink.master.proxy("/source/talker1").unregisterPublisher("/chatter", uri)
    assert not sink.publishers("/chatter")
    sink.relay.refresh()
    wait_until(lambda: sink.publishers("/chatter"), "the registration", 2)


def test_a_cancelled_import_can_come_back_at_once(sides):
    source, sink = sides
    connect(source, sink)
    for _ in range(10):
        sink.relay.apply(set(), set())
        sink.relay.apply(set(), {imported(source)})
    wait_for(sink, LinkState.ACTIVE)
    assert sink.publishers("/chatter") == ["/source/talker1"]
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
        assert subscriber.text_of_message()


@pytest.mark.parametrize(
    ("ours", "theirs", "state"),
    [
        (b"secret", b"secret", LinkState.ACTIVE),
        (b"secret", b"other", LinkState.REFUSED),
        (b"secret", None, LinkState.REFUSED),
        (None, b"secret", LinkState.REFUSED),
    ],
)
def test_gateways_with_different_credentials_do_not_link(relays, talkers, ours, theirs, state, caplog):
    source, sink = relays("source", credential=ours), relays("sink", credential=theirs)
    source.relay.apply({export()}, set())
    sink.relay.apply(set(), {imported(source)})
    wait_for(sink, state)
    assert "secret" not in caplog.text + str(source.relay._context.config) + sink.link().reason


def test_a_stranger_who_proves_nothing_gets_nothing(relays, talkers):
    source = relays("source", credential=b"secret")
    fields = {
        "relay": "1",
        "topic": "/chatter",
        "type": ANY,
        "md5sum": ANY,
        "source_node": "/talker1",
        "source_gateway": "source",
        "sink_gateway": "sink",
        "gateways_passed": "sink",
        "nonce": "00",
    }
    with socket.create_connection(source.address) as stranger:
        stranger.sendall(header_bytes(fields))
        assert stranger.recv(4)
        source.relay.apply({export()}, set())
        wait_for(source, LinkState.PENDING)


def test_a_loop_is_refused(relays, talkers):
    source = relays("source")
    source.relay.apply({Export("/chatter", STRING, "/talker1", "source")}, {imported(source)})
    wait_until(lambda: LinkState.REFUSED in source.state(), "the loop is refused", 3)
    assert "loop" in str(source.relay.status().imports)


def test_garbage_ends_its_own_connection_only(sides, caplog):
    source, sink = sides
    connect(source, sink)
    seeded = random.Random(7)
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
        assert subscriber.text_of_message()
        proxy = int(subscriber.uri.split(":")[2].split("/")[0])
        heads = [b"\xff\xff\xff\xff", b"POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\n<boo>", b"GET / HTTP/1.0\r\n\r\n"]
        heads += [b"POST " + b"x" * 20000, header_bytes({"relay": "2"}), header_bytes({"topic": "/chatter"}) * 2]
        heads += [struct.pack("<I", seeded.randrange(64)) + seeded.randbytes(80) for _ in range(40)]
        for port, head in itertools.product((source.relay.port, proxy), heads):
            with socket.create_connection(("127.0.0.1", port), 5) as stranger, contextlib.suppress(ConnectionError):
                stranger.sendall(head)
                stranger.shutdown(socket.SHUT_WR)
                stranger.settimeout(5)
                while stranger.recv(65536):
                    pass
        numbers = [int(subscriber.text_of_message()[:8]) for _ in range(20)]
    assert numbers == list(range(numbers[0], numbers[0] + 20))
    assert not [record for record in caplog.records if record.levelno > logging.WARNING]
    assert all("\n" not in record.getMessage() for record in caplog.records)


def test_who_says_nothing_is_closed(relays):
    source = relays("source", handshake_timeout=0.1)
    with socket.create_connection(source.address, 5) as silent:
        silent.settimeout(2)
        assert silent.recv(1) == b""


def test_one_connection_asked_for_twice_is_an_error_and_changes_nothing(sides):
    source, sink = sides
    connect(source, sink)
    with pytest.raises(ConnectionConflictError):
        sink.relay.apply(set(), {imported(source), imported(source, allowed="/x")})
    with pytest.raises(re.error):
        sink.relay.apply(set(), {imported(source, allowed="(")})
    assert sink.state() == [LinkState.ACTIVE]


def test_changes_are_announced(sides):
    source, sink = sides
    sink.changes.clear()
    connect(source, sink)
    assert sink.changes.wait(1)
