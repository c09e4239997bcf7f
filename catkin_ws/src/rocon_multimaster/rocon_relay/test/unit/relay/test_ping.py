"""A ping that meets a filled queue."""

import contextlib
import logging
import threading

import pytest
from relay_side import Outsider, export
from std_msgs.msg import String

from pioneer_harness.wait import wait_until
from tcpros.frame import CONTROL_MARK, control_frame
from tcpros.node import Node
from tcpros.node_context import NodeContext
from tcpros.reactor import Reactor

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

SIZE = 16_000_000
"""More than the buffers of two sockets hold [bytes]."""


@contextlib.contextmanager
def latched_once(master, size):
    """A node that publishes one latched message and is silent from then on."""
    reactor = Reactor(logging.getLogger("test"))
    context = NodeContext(reactor, master.uri, "127.0.0.1", "127.0.0.1", logging.getLogger("test"))
    registered, ended = threading.Event(), threading.Event()
    node = Node(context, "/large", lambda _: None)
    publication = node.publish("/words", String, latching=True)
    publication.send(size.to_bytes(4, "little") + bytes(size))
    node.when_registered(registered.set)
    reactor.start()
    assert registered.wait(5)
    yield
    reactor.call(lambda: node.close(ended.set))
    assert ended.wait(5)
    reactor.call(reactor.stop)
    reactor.join(5)


def test_a_ping_that_meets_a_filled_queue_is_answered_once_the_queue_is_sent(relays):
    """Such a link was closed seconds after a large latched message, and its subscribers with it."""
    source = relays("source")
    source.relay.apply({export("/words", "/large")}, set())
    with latched_once(source.master, SIZE):
        outsider = Outsider(source, topic="/words", source_node="/large")
        outsider.socket.settimeout(10)
        assert "error" not in outsider.answer()
        outsider.socket.sendall(control_frame(op="subscribe", demand="1"))
        wait_until(lambda: source.link().messages == 1, "the whole message is sent or queued", 10)
        outsider.socket.sendall(control_frame(op="ping", token="7", last="0.5"))
        wait_until(lambda: "sink" in source.relay.status().latencies, "the ping has come", 5)
        with outsider.socket.makefile("rb") as file:
            assert file.read(4) == CONTROL_MARK
            header = file.read(int.from_bytes(file.read(4), "little"))
            assert b"op=connected" in header
            assert file.read(4 + SIZE) == SIZE.to_bytes(4, "little") + bytes(SIZE)
            assert file.read(4) == CONTROL_MARK
            pong = file.read(int.from_bytes(file.read(4), "little"))
        assert b"op=pong" in pong
        assert b"token=7" in pong
        outsider.socket.close()
