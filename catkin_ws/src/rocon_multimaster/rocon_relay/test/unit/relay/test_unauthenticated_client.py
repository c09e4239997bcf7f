"""Credentials, loops, and clients that do not speak the protocol."""

import contextlib
import dataclasses
import itertools
import logging
import socket
import time

import nonsense
import pytest
from nonsense import drawn
from relay_side import (
    STRING,
    Outsider,
    Subscriber,
    connect,
    export,
    imported,
    wait_for,
)

from pioneer_harness.wait import wait_until
from rocon_relay.connection import ANY, Address, Export, Import, LinkState, Subject
from rocon_relay.keyring import PasswordKeyring, key_name
from rocon_relay.link import proof
from tcpros.header import header_bytes

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.mark.parametrize(
    ("ours", "theirs", "state"),
    [
        ("secret", "secret", LinkState.ACTIVE),
        ("secret", "other", LinkState.REFUSED),
        ("secret", None, LinkState.REFUSED),
        (None, "secret", LinkState.REFUSED),
    ],
)
def test_gateways_with_different_credentials_do_not_link(
    relays, talkers, ours, theirs, state, caplog
):
    source, sink = relays("source", password=ours), relays("sink", password=theirs)
    source.relay.apply({export()}, set())
    sink.relay.apply(set(), {imported(source)})
    wait_for(sink, state)
    assert "secret" not in caplog.text + str(source.relay._context.config) + sink.link().reason


def test_a_gateway_of_another_hub_is_refused_until_both_know_the_hub(relays, talkers):
    source, sink = (
        relays("source", password="secret", salt="one"),
        relays("sink", password="secret", salt="two"),
    )
    source.relay.apply({export()}, set())
    sink.relay.apply(set(), {imported(source)})
    wait_for(sink, LinkState.REFUSED)
    assert "on no hub of ours" in sink.link().reason
    source.keyring.learn("two")
    wait_for(sink, LinkState.ACTIVE)


def test_a_salt_that_its_hub_has_replaced_is_not_used_any_more():
    keyring = PasswordKeyring(lambda: "secret")
    for salt in ("one", "other"):
        keyring.learn(salt)
    keyring.learn("two", "one")
    assert set(keyring.names()) == {key_name("two"), key_name("other")}
    keyring.learn("two", "")
    assert len(keyring.names()) == 2


def test_a_password_that_changes_leaves_links_up_and_holds_for_new_ones(relays, talkers):
    source, sink = relays("source", password="secret"), relays("sink", password="secret")
    connect(source, sink)
    source.password = "other"
    source.keyring.refresh()
    both = (
        {export(), export(topic="/latched")},
        {imported(source), imported(source, topic="/latched")},
    )
    source.relay.apply(both[0], set())
    sink.relay.apply(set(), both[1])
    wait_until(
        lambda: sorted(sink.state()) == [LinkState.ACTIVE, LinkState.REFUSED],
        "the new link is refused",
        5,
    )
    sink.password = "other"
    sink.keyring.refresh()
    wait_for(sink, LinkState.ACTIVE)


def test_the_connecting_side_proves_itself_first_and_learns_no_secret(relays, talkers):
    """The source once sent an HMAC of the password to any client: 100,000 passwords could be tried on it in 10 s."""
    source = relays("source", password="secret")
    source.relay.apply({export()}, set())
    outsider = Outsider(source)
    assert set(outsider.answer()) == {"relay", "challenge", "key"}
    outsider.socket.sendall(header_bytes({"relay": "2", "proof": "00" * 32}))
    assert outsider.answer() == {
        "relay": "2",
        "error": "its password differs from ours",
        "state": "refused",
    }
    wait_for(source, LinkState.PENDING)


def test_a_hello_with_a_field_that_the_source_does_not_know_is_proved_as_well(relays, talkers):
    """The source once computed the proof only from the fields that it knew, so it refused newer gateways."""
    source = relays("source", password="secret")
    source.relay.apply({export()}, set())
    newer = Outsider(source, beside={"every": "5"})
    asked = newer.answer()
    key = source.keyring.key((asked["key"],))[1]
    shown = proof(key, "sink", newer.sent, asked["challenge"])
    newer.socket.sendall(header_bytes({"relay": "2", "proof": shown}))
    assert newer.answer()["proof"] == proof(key, "source", newer.sent, asked["challenge"])


def test_a_source_that_does_not_prove_itself_is_refused(relays, talkers):
    """A host that has taken over a gateway's address accepts every link but does not know the password."""
    sink = relays("sink", password="secret", retry_shortest=60.0)
    with socket.create_server(("127.0.0.1", 0)) as rogue:
        sink.relay.apply(
            set(),
            {
                dataclasses.replace(
                    imported(relays("source")), address=Address(*rogue.getsockname())
                )
            },
        )
        connection, _ = rogue.accept()
        with connection:
            connection.sendall(
                header_bytes({"relay": "2", "challenge": "00", "key": sink.keyring.names()[0]})
            )
            connection.sendall(
                header_bytes({"relay": "2", "source_gateway": "source", "proof": "00" * 32})
            )
            wait_for(sink, LinkState.REFUSED)
    assert "does not prove that it knows our password" in sink.link().reason


@pytest.mark.parametrize(
    "changes", [{}, {"subject": Subject.SERVICE, "topic": "/echo", "source_node": "/server"}]
)
def test_a_link_that_stands_is_not_evicted_by_who_proves_nothing(relays, talkers, changes):
    """Without a password, any client that guessed two gateways' names once took over the link; messages were lost."""
    source, sink = relays("source", patience=0.3), relays("sink")
    echo = Export("/echo", ANY, "/server", "sink", subject=Subject.SERVICE)
    source.relay.apply({export(), echo}, set())
    wanted = Import("/echo", ANY, ANY, "source", "/server", source.address, subject=Subject.SERVICE)
    sink.relay.apply(set(), {imported(source), wanted})
    wait_for(sink, LinkState.ACTIVE)
    outsider = Outsider(source, **changes)
    assert outsider.answer()["state"] == "refused"
    assert sink.state() == [LinkState.ACTIVE, LinkState.ACTIVE]


@pytest.mark.parametrize(
    "changes", [{}, {"source_gateway": "robot"}, {"source_node": "/talker2"}, {"topic": "/other"}]
)
def test_a_refusal_tells_who_guesses_nothing_about_names(relays, talkers, changes):
    source = relays("source", patience=0.3)
    asked, outsider = time.monotonic(), Outsider(source, sink_gateway="guess", **changes)
    answer, took = outsider.answer(), time.monotonic() - asked
    asked_for = outsider.hello
    expected = f"{asked_for.source_gateway} exports no publisher {asked_for.source_node} of {asked_for.topic} to guess"
    assert answer == {"relay": "2", "error": expected, "state": "refused"}
    assert took > 0.25


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
        heads = [
            b"\xff\xff\xff\xff",
            b"POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\n<boo>",
            b"GET / HTTP/1.0\r\n\r\n",
        ]
        heads += [header_bytes({"topic": "/chatter"}) * 2, *drawn(nonsense.heads, 60)]
        for port, head in itertools.product((source.relay.port, proxy), heads):
            with (
                socket.create_connection(("127.0.0.1", port), 5) as outsider,
                contextlib.suppress(ConnectionError),
            ):
                outsider.sendall(head)
                outsider.shutdown(socket.SHUT_WR)
                outsider.settimeout(5)
                while outsider.recv(65536):
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


@pytest.mark.parametrize("reason", [b"\xff\xfe", b"a\x00b\x1b[2J", "é\n".encode(), b"x" * 60_000])
def test_a_refusal_of_any_bytes_is_a_reason_that_messages_and_xml_can_carry(
    relays, talkers, reason
):
    """One byte that is not UTF-8 once made the list of rules unserialisable."""
    sink = relays("sink", retry_shortest=60.0)
    with socket.create_server(("127.0.0.1", 0)) as rogue:
        address = Address(*rogue.getsockname())
        sink.relay.apply(set(), {dataclasses.replace(imported(relays("source")), address=address)})
        connection, _ = rogue.accept()
        with connection:
            text = reason.decode("utf-8", "surrogateescape")
            connection.sendall(header_bytes({"relay": "2", "error": text, "state": "refused"}))
            wait_for(sink, LinkState.REFUSED)
    found = sink.link().reason
    assert found.isprintable()
    assert len(found) < 1200
    assert found.encode()
