"""XML-RPC at a proxy's port: any client gets answers as long as it sends requests."""

import contextlib
import itertools
import socket
import time
import xmlrpc.client

import pytest
from relay_side import connect

from pioneer_harness.wait import wait_until
from tcpros.http import http_message
from tcpros.node_port import MAX_UNIDENTIFIED

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

BODY = xmlrpc.client.dumps(("/tester",), "getBusInfo").encode()
REQUEST = b"POST / HTTP/1.1\r\nContent-Length: %d\r\n\r\n%s" % (len(BODY), BODY)
FLOOD = 120_000


class Asker:
    """A persistent connection to a proxy."""

    def __init__(self, port, receive_buffer=None):
        self.socket = socket.socket()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(5)
        self.socket.connect(("127.0.0.1", port))
        self._data = b""

    def answer(self):
        """Returns the slave API's status code in the next answer; None at the end."""
        while not (message := http_message(self._data, 0)) or len(self._data) < message.end:
            more = self.socket.recv(1 << 16)
            if not more:
                return None
            self._data += more
        (answer,), _ = xmlrpc.client.loads(self._data[message.start : message.end])
        self._data = self._data[message.end :]
        return answer[0]

    def ask(self):
        self.socket.sendall(REQUEST)
        return self.answer()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()


def port_of_proxy(sink):
    return int(sink.master.proxy().lookupNode("/source/talker1").split(":")[2].split("/")[0])


def waiting(sink):
    """Returns the largest amount of unsent data on any connection of the sink's proxies [bytes]."""
    nodes = tuple(sink.relay._nodes._nodes.values())
    return max(
        (one.backlog.size for node in nodes for one in tuple(node._port._connections)), default=0
    )


def test_who_asks_and_takes_no_answer_is_not_read_until_it_does(relays, talkers):
    source, sink = relays("source"), relays("sink", handshake_timeout=60.0)
    connect(source, sink)
    with Asker(port_of_proxy(sink), 4096) as asker:
        asker.socket.settimeout(1)
        sent, flood = 0, memoryview(REQUEST * FLOOD)
        with contextlib.suppress(TimeoutError):
            while sent < len(flood):
                sent += asker.socket.send(flood[sent : sent + 65536])
        assert sent < len(flood), "all of it was read"
        assert waiting(sink) < 64 * 1024
        asker.socket.settimeout(10)
        assert all(asker.answer() == 1 for _ in range(sent // len(REQUEST)))
        asker.socket.sendall(flood[sent : sent + len(REQUEST) - sent % len(REQUEST)])
        assert asker.answer() == 1


def test_a_connection_on_which_nothing_more_is_asked_is_closed_silently(relays, talkers, caplog):
    source, sink = relays("source"), relays("sink", handshake_timeout=2.0)
    connect(source, sink)
    with Asker(port_of_proxy(sink)) as busy, Asker(port_of_proxy(sink)) as idle:
        began = time.monotonic()
        assert idle.ask() == 1
        wait_until(
            lambda: busy.ask() == 1 and time.monotonic() - began > 4.5,
            "twice what idle is allowed",
            10,
        )
        assert idle.answer() is None
        assert busy.ask() == 1
    assert not caplog.records


def test_connections_that_have_asked_count_and_make_room_for_newcomers(sides, caplog):
    source, sink = sides
    connect(source, sink)
    port = port_of_proxy(sink)
    with contextlib.ExitStack() as stack:
        first = stack.enter_context(Asker(port))
        assert first.ask() == 1
        for _ in itertools.repeat(None, MAX_UNIDENTIFIED):
            assert stack.enter_context(Asker(port)).ask() == 1
        assert first.answer() is None
    assert not caplog.records
