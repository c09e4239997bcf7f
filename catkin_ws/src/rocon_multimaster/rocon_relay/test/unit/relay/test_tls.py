"""Links over TLS: which peers are admitted; each refused peer is logged in one line and has no other effect."""

import dataclasses
import logging
import socket

import pytest
from relay_side import Subscriber, connect, export, imported, number_of_good, wait_for
from tcp_proxy import TcpProxy

from pioneer_harness.wait import wait_until
from rocon_relay.connection import Address, LinkState
from tcpros.header import header_bytes

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.fixture
def guarded(relays, talkers, identities):
    """A source and a sink with certificates of one fleet, and a subscriber that must keep receiving throughout."""
    source, sink = (
        relays("source", certificates=identities("one")),
        relays("sink", certificates=identities("two")),
    )
    connect(source, sink)
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
        first = number_of_good(subscriber)
        yield source, sink
        heard = [number_of_good(subscriber) for _ in range(10)]
    assert heard == list(range(first + 1, first + 11))


def warnings(caplog):
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


@pytest.mark.parametrize(
    ("theirs", "logged", "reason"),
    [
        (
            {"fleet": "theirs"},
            "refuses our certificate: unknown ca",
            "certificate is not good: self-signed",
        ),
        (
            {"name": "old", "days": -1},
            "certificate has expired",
            "certificate: certificate expired",
        ),
        (
            None,
            "it speaks no TLS",
            "it speaks TLS only, and we have no certificate: set ROCON_TLS_DIRECTORY",
        ),
    ],
    ids=["of another fleet", "expired", "none"],
)
def test_a_gateway_without_a_good_certificate_is_refused_and_both_say_why(
    relays, talkers, identities, caplog, theirs, logged, reason
):
    source = relays("source", certificates=identities())
    sink = relays("sink", retry_shortest=60.0, certificates=theirs and identities(**theirs))
    source.relay.apply({export()}, set())
    sink.relay.apply(set(), {imported(source)})
    wait_for(sink, LinkState.REFUSED)
    assert reason in sink.link().reason
    wait_until(lambda: warnings(caplog), "the source's line", 5)
    (line,) = warnings(caplog)
    assert logged in line
    assert source.state() == [LinkState.PENDING]


def test_a_gateway_with_certificates_does_not_do_without(relays, talkers, identities, caplog):
    source, sink = relays("source"), relays("sink", retry_shortest=60.0, certificates=identities())
    source.relay.apply({export()}, set())
    sink.relay.apply(set(), {imported(source)})
    wait_for(sink, LinkState.REFUSED)
    assert "TLS: it speaks no TLS" in sink.link().reason
    (line,) = warnings(caplog)
    assert "it speaks TLS, and this gateway has no certificate (ROCON_TLS_DIRECTORY)" in line


def test_a_credential_holds_inside(relays, talkers, identities):
    settings = {"certificates": identities(), "retry_shortest": 60.0}
    source, sink = (
        relays("source", password="right", **settings),
        relays("sink", password="wrong", **settings),
    )
    connect(source, sink, state=LinkState.REFUSED)
    assert "password differs" in sink.link().reason


@pytest.mark.parametrize(
    "said",
    [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(600),
        b"\x16\x03\x01\xff\xff" + bytes(300),
        b"\xff" * 100,
        b"GET / HTTP/1.0\r\n\r\n",
        header_bytes({"relay": "2", "topic": "/chatter"}),
    ],
    ids=[
        "a handshake of nonsense",
        "a record too long",
        "nonsense",
        "http",
        "half a hello in plain",
    ],
)
def test_an_unauthenticated_client_is_one_line(guarded, caplog, said):
    source, _ = guarded
    with socket.create_connection(source.address, 5) as client:
        client.sendall(said)
        while client.recv(65536):
            pass
    wait_until(lambda: warnings(caplog), "the line", 5)
    assert len(warnings(caplog)) == 1


def test_who_only_looks_whether_the_port_answers_is_no_line(guarded, caplog):
    source, _ = guarded
    socket.create_connection(source.address, 5).close()
    wait_until(lambda: not source.relay._unidentified, "the end of the connection", 5)
    assert warnings(caplog) == []


def test_half_a_handshake_ends_in_time_and_holds_up_nobody(relays, talkers, identities, caplog):
    source = relays("source", certificates=identities(), handshake_timeout=2.0)
    sink = relays("sink", certificates=identities())
    with (
        socket.create_connection(source.address, 5) as silent,
        socket.create_connection(source.address, 5) as slow,
    ):
        slow.sendall(b"\x16\x03\x01\x02\x00\x01")
        connect(source, sink)
        for client in (silent, slow):
            client.settimeout(5)
            assert client.recv(1) == b""
    wait_until(lambda: len(warnings(caplog)) > 1, "a line for each", 5)
    assert ["did not introduce itself within" in line for line in warnings(caplog)] == [True, True]
    assert "malformed" not in caplog.text
    assert sink.state() == [LinkState.ACTIVE]


def test_a_relay_that_hung_in_a_handshake_is_no_proof_of_a_small_mtu(relays, talkers, identities):
    source = relays("source", certificates=identities("one"))
    sink = relays("sink", certificates=identities("two"), handshake_timeout=2.0)
    proxy = TcpProxy("127.0.0.1", source.relay.port)
    proxy.swallows = True
    wanted = dataclasses.replace(imported(source), address=Address("127.0.0.1", proxy.port))
    source.relay.apply({export()}, set())
    sink.relay.apply(set(), {wanted})
    try:
        wait_until(lambda: "no answer in time" in sink.link().reason, "the end of the dial", 10)
        proxy.swallows = False
        wait_for(sink, LinkState.ACTIVE, 20)
        assert "the other gateway was busy, or full packets" in sink.link().reason
        assert "set the MTU" not in sink.link().reason
    finally:
        proxy.close()
