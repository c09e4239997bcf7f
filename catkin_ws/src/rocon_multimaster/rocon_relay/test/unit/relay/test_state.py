"""Link states: which nodes have access, what is missing or ends, and what recovers."""

import dataclasses
import socket
import sys

import pytest
from relay_side import NODES, STRING, Subscriber, connect, export, imported, node_at, wait_for

from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until
from rocon_relay.connection import ANY, ConnectionConflictError, LinkState
from rocon_relay.pattern import PatternError
from tcpros.header import header_bytes

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


def test_only_allowed_nodes_may_subscribe(sides):
    source, sink = sides
    connect(source, sink, allowed=("/good.*",))
    with Subscriber(sink, "/source/talker1", "/chatter", "/bad") as bad:
        assert bad.header is None
        assert "/good.*" in bad.text
    with Subscriber(sink, "/source/talker1", "/chatter", "/good1") as good:
        assert good.text_of_message()
        sink.relay.apply(set(), {imported(source, allowed=("/better",))})
        assert good.is_ended(1)
        assert sink.link().state is LinkState.ACTIVE


def test_rules_with_flags_and_groups_hold_beside_one_another(sides):
    """Two of them, joined into one expression, were once invalid and ended the gateway."""
    source, sink = sides
    allowed = ("(?i)/viewer", "/(?P<twice>ab)+", "/(?P<twice>c)c")
    connect(source, sink, allowed=allowed)
    for name in ("/VIEWER", "/abab", "/cc"):
        with Subscriber(sink, "/source/talker1", "/chatter", name) as allowed:
            assert allowed.text_of_message()
    for name in ("/ABAB", "/abc", "/viewer2"):
        with Subscriber(sink, "/source/talker1", "/chatter", name) as barred:
            assert f"not for {name}" in barred.text


def test_a_subscriber_of_another_type_gets_the_reason(sides):
    source, sink = sides
    connect(source, sink)
    with Subscriber(
        sink, "/source/talker1", "/chatter", type_="std_msgs/Bool", md5sum="0" * 32
    ) as subscriber:
        assert "std_msgs/Bool" in subscriber.header["error"]
    with Subscriber(
        sink, "/source/talker1", "/chatter", type_=STRING, md5sum="0" * 32
    ) as subscriber:
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
        waiting.sendall(
            header_bytes({"callerid": "/t", "topic": "/chatter", "type": ANY, "md5sum": ANY})
        )
        wait_for(sink, LinkState.NO_PUBLISHER)
        assert "/nobody" in sink.link().reason


def test_an_export_may_come_later_than_the_question_for_it(relays, talkers):
    # Long timeouts: during the test, the request is neither refused nor abandoned.
    source, sink = relays("source", patience=60.0), relays("sink", handshake_timeout=60.0)
    sink.relay.apply(set(), {imported(source)})
    wait_until(lambda: source.relay._parked, "the question", 5)
    source.relay.apply({export()}, set())
    wait_for(sink, LinkState.ACTIVE)


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
        wait_until(lambda: "/mortal" in source.publishers("/latched"), "the publisher", START)
        connect(source, sink, nodes=("/mortal",))
        subscriber = Subscriber(sink, "/source/mortal", "/chatter")
        assert subscriber.text_of_message()
    wait_for(sink, LinkState.NO_PUBLISHER)
    with ProcessGroup() as group, subscriber:
        group.start("mortal", argv, source.master.environment, tmp_path / "second")
        wait_for(sink, LinkState.ACTIVE, START)
        assert subscriber.text_of_message()


def test_a_master_that_has_forgotten_is_notified_again(sides):
    source, sink = sides
    connect(source, sink)
    uri = sink.master.proxy().lookupNode("/source/talker1")
    sink.master.proxy("/source/talker1").unregisterPublisher("/chatter", uri)
    assert not sink.publishers("/chatter")
    sink.relay.refresh()
    wait_until(lambda: sink.publishers("/chatter"), "the registration", 2)


def test_a_proxy_that_gets_another_name_replaces_the_former_one(sides):
    """Gateways `pi-1` and `pi_1` get different names once both are there."""
    source, sink = sides
    connect(source, sink)
    for alias in ("source_1f2e", ""):
        wanted = dataclasses.replace(imported(source), alias=alias)
        sink.relay.apply(set(), {wanted})
        name = f"/{alias or 'source'}/talker1"
        wait_until(lambda n=name: sink.publishers("/chatter") == [n], "the new name", 5)
        with Subscriber(sink, name, "/chatter") as subscriber:
            assert subscriber.header["callerid"] == name
            assert subscriber.text_of_message()


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


def test_a_shutdown_unregisters_also_what_comes_after_an_import_that_was_never_shown(sides):
    source, sink = sides
    source.relay.apply({export()}, set())
    sink.relay.apply(
        set(), {imported(source, topic="/never", node="/nobody")}
    )  # requested first, never exported
    sink.relay.apply(set(), {imported(source, topic="/never", node="/nobody"), imported(source)})
    wait_until(lambda: sink.publishers("/chatter"), "a registration", 5)
    sink.relay.shutdown()
    assert not sink.publishers("/chatter")


def test_one_connection_asked_for_twice_is_an_error_and_changes_nothing(sides):
    source, sink = sides
    connect(source, sink)
    with pytest.raises(ConnectionConflictError):
        sink.relay.apply(set(), {imported(source), imported(source, allowed=("/x",))})
    with pytest.raises(PatternError):
        sink.relay.apply(set(), {imported(source, allowed=("(",))})
    assert sink.state() == [LinkState.ACTIVE]


def test_changes_are_announced(sides):
    source, sink = sides
    sink.changes.clear()
    connect(source, sink)
    assert sink.changes.wait(1)
