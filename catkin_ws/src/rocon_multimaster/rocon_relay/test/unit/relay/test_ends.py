"""Connections that end in the middle of something leave nothing behind."""

import contextlib
import logging
import socket
import struct

import pytest

from rocon_relay.connection import Export, RelayConfig, Subject
from rocon_relay.context import Context
from rocon_relay.export_end import ExportEnd
from rocon_relay.link import Hello
from rocon_relay.subscription import Subscription
from tcpros.header import header_bytes
from tcpros.reactor import Reactor

RESET = struct.pack("ii", 1, 0)
"""SO_LINGER by which `close` tells the other end at once that the connection is no more."""


class Exporter:
    """Admits every link and keeps the only subscription."""

    def __init__(self, context):
        self.context = context
        self.export = Export("/chatter", "*", "/talker", "sink")
        self.current = None
        self.emptied = 0

    def admit(self, end, hello):
        end.accept(self.export)

    def subscription(self, export):
        self.current = self.current or Subscription(self.context, export, self._emptied)
        return self.current

    def ended(self, end):
        """Does nothing: no state of the link is kept here."""

    def _emptied(self):
        self.emptied += 1


@pytest.fixture
def exporter():
    """An exporter whose loop does not run, so that only the test makes things happen."""
    logger = logging.getLogger("relay.ends")
    reactor = Reactor(logger)
    config = RelayConfig("source", "/gateway", "http://127.0.0.1:1/", "127.0.0.1")
    yield Exporter(Context(config, reactor, logger, lambda: None, None))
    reactor.stop()
    reactor.run()


@contextlib.contextmanager
def connection():
    """Yields both ends of a connection."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        dialled = socket.create_connection(listener.getsockname())
        accepted, _ = listener.accept()
    with dialled:
        yield dialled, accepted


def test_a_link_that_ends_while_connecting_leaves_no_subscription_behind(exporter):
    with connection() as (sink, accepted):
        end = ExportEnd(exporter.context, exporter, accepted, "sink")
        end.hello = Hello(
            "/chatter", "*", "*", "/talker", "source", "sink", ("sink",), "00", Subject.TOPIC
        )
        end.accept(exporter.export)
        end.parse(
            memoryview(b"\xff\xff\xff\xff" + header_bytes({"op": "subscribe", "demand": "1"}))
        )
        sink.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
    exporter.current.found({"type": "std_msgs/String", "md5sum": "0", "latching": "0"})
    assert end.is_closed
    assert len(exporter.current.fanout) == 0
    assert exporter.emptied == 1
