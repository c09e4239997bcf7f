"""Credentials, loops and whoever does not speak the protocol."""

import contextlib
import itertools
import logging
import socket

import nonsense
import pytest
from nonsense import drawn
from relay_side import (
    STRING,
    Subscriber,
    connect,
    export,
    imported,
    wait_for,
)

from pioneer_harness.wait import wait_until
from rocon_relay.core.connection import ANY, Export, LinkState
from tcpros.core.header import header_bytes

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


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
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
        assert subscriber.text_of_message()
        proxy = int(subscriber.uri.split(":")[2].split("/")[0])
        heads = [b"\xff\xff\xff\xff", b"POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\n<boo>", b"GET / HTTP/1.0\r\n\r\n"]
        heads += [header_bytes({"topic": "/chatter"}) * 2, *drawn(nonsense.heads, 60)]
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
