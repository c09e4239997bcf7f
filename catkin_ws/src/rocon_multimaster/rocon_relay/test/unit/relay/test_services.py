"""Service calls across two relays: what clients receive, even when something ends during a call."""

import contextlib
import socket
import struct
import sys
import threading
import time
from io import BytesIO
from urllib.parse import urlsplit

import pytest
from gateway_msgs.srv import ConnectHub, ConnectHubRequest, ConnectHubResponse
from relay_side import NODES, Outsider, node_at, wait_for

from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until
from rocon_relay import service_import
from rocon_relay.connection import ANY, Export, Import, LinkState, Subject
from tcpros.header import header_bytes, header_fields

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

MEGABYTES = 5_000_000


class ServiceFailedError(Exception):
    """The service answered with an error, which is in the text."""


class Client:
    """A ROSRPC client without ROS's code: one connection to the server that the master names."""

    def __init__(self, side, service="/echo", md5sum=ConnectHub._md5sum, **fields):
        address = urlsplit(side.master.proxy().lookupService(service))
        self.socket = socket.create_connection((address.hostname, address.port), timeout=15)
        header = {"service": service, "md5sum": md5sum, "callerid": "/tester", **fields}
        self.socket.sendall(header_bytes(header))
        self.header = header_fields(self._frame())

    def call(self, text):
        """Returns the answer's text; raises ServiceFailedError, or ConnectionError if the connection ends."""
        body = BytesIO()
        ConnectHubRequest(text).serialize(body)
        self.socket.sendall(struct.pack("<I", len(body.getvalue())) + body.getvalue())
        good = self._exactly(1)
        answer = self._frame()
        if good != b"\x01":
            raise ServiceFailedError(answer.decode())
        return ConnectHubResponse().deserialize(answer).error_message

    def _frame(self):
        return self._exactly(struct.unpack("<I", self._exactly(4))[0])

    def _exactly(self, size):
        data = bytearray()
        while len(data) < size:
            more = self.socket.recv(min(size - len(data), 1 << 20))
            if not more:
                raise ConnectionError("ended")
            data += more
        return bytes(data)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()


def start_server(group, master, log, name="server", service="/echo"):
    argv = [sys.executable, str(NODES / "server.py"), f"__name:={name}", f"/echo:={service}"]
    group.start(name, argv, master.environment, log, may_end=True)
    wait_until(lambda: f"/{name}" in master.system_state()[2].get(service, []), name, START)


@pytest.fixture(scope="module")
def server(source_master, tmp_path_factory):
    with ProcessGroup() as group:
        start_server(group, source_master, tmp_path_factory.mktemp("server") / "log")
        yield group


def imported(source, service="/echo", node="/server"):
    return Import(service, ANY, ANY, "source", node, source.address, subject=Subject.SERVICE)


def connect(source, sink, service="/echo", node="/server"):
    source.relay.apply({Export(service, ANY, node, "sink", subject=Subject.SERVICE)}, set())
    sink.relay.apply(set(), {imported(source, service, node)})
    wait_for(sink, LinkState.ACTIVE)


@pytest.fixture
def sink(relays, server):
    """A sink that offers the source's /echo."""
    source, sink = relays("source"), relays("sink")
    connect(source, sink)
    return sink


def test_a_call_crosses_and_the_proxy_is_a_node_of_its_own(sink):
    assert sink.master.system_state()[2] == {"/echo": ["/source/server"]}
    with node_at(sink.master.proxy().lookupNode("/source/server")) as node:
        assert node.getName("/tester")[2] == "/source/server"
    with Client(sink) as client:
        assert client.header["callerid"] == "/source/server"
        assert client.header["type"] == "gateway_msgs/ConnectHub"
        assert client.call("hello") == "hello"
        with pytest.raises((ServiceFailedError, ConnectionError)):
            client.call("the server ends a connection that is not persistent")


def test_the_server_sees_the_client_by_its_gateway(sink):
    with Client(sink) as client:
        assert client.call("who") == "/sink/tester"


def test_a_persistent_connection_carries_many_calls(sink):
    with Client(sink, persistent="1") as client:
        assert [client.call(str(number)) for number in range(50)] == [
            str(number) for number in range(50)
        ]
        assert sink.link().subscribers == 1
    wait_until(lambda: sink.link().subscribers == 0, "the client is gone", 5)
    assert sink.link().messages == 50


def test_a_probe_learns_the_type(sink):
    with Client(sink, md5sum="*", probe="1") as client:
        assert client.header["type"] == "gateway_msgs/ConnectHub"
        assert client.header["md5sum"] == ConnectHub._md5sum


def test_megabytes_cross_both_ways_whole(sink):
    text = ("0123456789abcdef" * (MEGABYTES // 16))[:MEGABYTES]
    with Client(sink, persistent="1") as client:
        for _ in range(3):
            assert client.call(text) == text


def test_a_client_that_reads_late_gets_everything_and_holds_up_nobody(sink):
    text = "x" * MEGABYTES
    with Client(sink, persistent="1") as slow, Client(sink, persistent="1") as quick:
        body = BytesIO()
        ConnectHubRequest(text).serialize(body)
        slow.socket.sendall(struct.pack("<I", len(body.getvalue())) + body.getvalue())
        assert quick.call("quick") == "quick"
        assert slow._exactly(1) == b"\x01"
        assert ConnectHubResponse().deserialize(slow._frame()).error_message == text


def test_a_slow_call_holds_up_no_other(sink):
    done = []

    def slow():
        with Client(sink) as client:
            done.append(client.call("hold"))

    threads = [threading.Thread(target=slow) for _ in range(8)]
    for thread in threads:
        thread.start()
    wait_until(lambda: sink.link().subscribers == 8, "eight calls under way", 10)
    with Client(sink) as client:
        assert client.call("quick") == "quick"
    assert not done
    with Client(sink) as client:
        assert client.call("release") == "release"
    for thread in threads:
        thread.join(10)
    assert done == ["hold"] * 8


def test_one_client_too_many_is_refused_and_told(sink, monkeypatch):
    monkeypatch.setattr(service_import, "MAX_CALLS", 1)
    with Client(sink, persistent="1") as first:
        assert first.call("first") == "first"
        with Client(sink) as second:
            assert "takes no more" in second.header["error"]
        assert first.call("continues") == "continues"


def test_an_error_of_the_server_is_an_error_to_the_client(sink):
    with Client(sink, persistent="1") as client:
        with pytest.raises(ServiceFailedError, match="as you wish"):
            client.call("fail")
        assert client.call("continues") == "continues"


def test_another_definition_is_refused_as_the_server_refuses_it(sink):
    with Client(sink, md5sum="0" * 32) as client:
        assert "md5sums do not match" in client.header["error"]
    assert sink.state() == [LinkState.ACTIVE]


def test_a_lost_link_ends_a_call_with_an_error(relays, server):
    source, sink = relays("source"), relays("sink")
    connect(source, sink)
    with Client(sink) as client:
        asked = time.monotonic()
        threading.Timer(0.3, source.relay.shutdown).start()
        with pytest.raises((ServiceFailedError, ConnectionError)):
            client.call("wait 20")
        assert time.monotonic() - asked < 3
    wait_until(lambda: sink.master.system_state()[2] == {}, "the proxy is gone", 3)


def test_taking_a_rule_back_ends_calls_and_registration(sink):
    with Client(sink) as client:
        thread = threading.Thread(target=take_back_during_a_call, args=(sink,))
        thread.start()
        with pytest.raises(ServiceFailedError, match="not relayed any more"):
            client.call("wait 20")
        thread.join()
    wait_until(lambda: sink.master.system_state()[2] == {}, "no registration", 2)


def take_back_during_a_call(sink):
    def is_called():
        (end,) = sink.relay._imports.values()
        return any(call.pipe and call.pipe.conversation.is_waiting for call in tuple(end.calls))

    wait_until(is_called, "the call under way", 10)
    sink.relay.apply(set(), set())


def test_garbage_and_half_handshakes_end_their_own_connection_only(sink, caplog):
    address = urlsplit(sink.master.proxy().lookupService("/echo"))
    good = header_bytes({"service": "/echo", "md5sum": "*", "callerid": "/t"})
    bad = [
        good + b"\xff\xff\xff\xff",
        good + b"\x05\x00\x00\x00ab",
        good[:9],
        header_bytes({"service": "/echo"}),
        header_bytes({"service": "/nothing", "md5sum": "*", "callerid": "/t"}),
        header_bytes({"service": "/echo", "md5sum": "*", "callerid": "not a name \x00\n"}),
        header_bytes({"service": "/echo", "md5sum": "*", "callerid": "/t", "x": "y" * 65000}),
    ]
    with Client(sink, persistent="1") as client:
        for head in bad:
            with socket.create_connection((address.hostname, address.port), 5) as raw:
                raw.sendall(head)
                raw.shutdown(socket.SHUT_WR)
                with contextlib.suppress(ConnectionError):
                    while raw.recv(65536):
                        pass
        assert client.call("still there") == "still there"
    assert all(record.levelname == "WARNING" for record in caplog.records)


def test_a_message_over_the_bound_ends_its_connection(relays, server, caplog):
    source, sink = relays("source"), relays("sink", max_message_size=1000)
    connect(source, sink)
    with Client(sink) as client, pytest.raises((ServiceFailedError, ConnectionError)):
        client.call("x" * 2000)
    with Client(sink) as client:
        assert client.call("short") == "short"


def test_a_credential_holds_for_calls(relays, server):
    source, sink = relays("source", password="secret"), relays("sink", password="secret")
    connect(source, sink)
    with Client(sink) as client:
        assert client.call("hello") == "hello"


def test_a_service_that_is_not_exported_is_refused(relays, server):
    source, sink = relays("source", patience=0.05), relays("sink")
    sink.relay.apply(set(), {imported(source)})
    wait_for(sink, LinkState.REFUSED)
    assert "exports no server /server of /echo to sink" in sink.link().reason


def test_a_dead_server_is_an_error_and_a_state_until_it_is_back(relays, source_master, tmp_path):
    source, sink = relays("source"), relays("sink")
    with ProcessGroup() as group:
        start_server(group, source_master, tmp_path / "log", "mortal", "/mortal_echo")
        connect(source, sink, "/mortal_echo", "/mortal")
        with Client(sink, "/mortal_echo") as client:
            asked = time.monotonic()
            with pytest.raises(ServiceFailedError, match="closed the connection"):
                client.call("die")
            assert time.monotonic() - asked < 2
        wait_until(lambda: not group.is_running("mortal"), "the server has died", 5)
        with Client(sink, "/mortal_echo") as client:
            assert "Connection refused" in client.header["error"]
        wait_until(lambda: sink.state() == [LinkState.NO_SERVER], "the state", 3)
        master = source_master.proxy("/mortal")
        assert master.unregisterService("/mortal_echo", master.lookupService("/mortal_echo"))
        with Client(sink, "/mortal_echo") as client:
            assert "no provider" in client.header["error"]
        start_server(group, source_master, tmp_path / "log2", "mortal", "/mortal_echo")
        with Client(sink, "/mortal_echo") as client:
            assert client.call("back") == "back"
        wait_until(lambda: sink.state() == [LinkState.ACTIVE], "active again", 3)


def test_a_service_that_moves_while_its_new_link_waits_leaves_nothing_undone(relays, talkers):
    """Closing the old node's link admitted the waiting one too early, and the rest of the change was not made."""
    source = relays("source", patience=20.0)
    moving = {"topic": "/moving", "subject": Subject.SERVICE}

    def exported(node):
        return Export("/moving", ANY, node, "sink", subject=Subject.SERVICE)

    source.relay.apply({exported("/one")}, set())
    first = Outsider(source, source_node="/one", **moving)
    assert "error" not in first.answer()
    second = Outsider(source, source_node="/two", **moving)
    wait_until(lambda: source.relay._parked, "the link for the other node waits", 5)
    source.relay.apply({exported("/two")}, {imported(source)})
    assert "error" not in second.answer()
    assert first.answer() is None
    status = source.relay.status()
    assert len(status.imports) == 1, "imports follow exports"
    for outsider in (first, second):
        outsider.socket.close()
