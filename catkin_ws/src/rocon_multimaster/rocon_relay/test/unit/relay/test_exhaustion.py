"""File descriptors run out and become free again: failures are logged once, and everything works afterwards."""

import errno
import logging
import os
import re
import socket
import sys

import pytest
from relay_side import Subscriber, connect, number_of_good, wait_for
from test_services import Client, start_server
from test_services import connect as connect_service

from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until
from rocon_relay.connection import ANY, Export, Import, LinkState, Subject
from tcpros import dialled_stream, listener

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


class Scarce:
    """Replaces the module `socket`; one of the relay's modules gets no sockets for a given number of attempts."""

    def __init__(self):
        self._left = {}

    def refuse(self, module, times):
        self._left[
            next(
                name
                for name in sys.modules
                if re.fullmatch(rf"(tcpros|rocon_relay)\.{module}", name)
            )
        ] = times

    @property
    def is_over(self):
        return not any(self._left.values())

    def socket(self, *arguments):
        for depth in range(1, 5):
            asking = sys._getframe(depth).f_globals["__name__"]
            if self._left.get(asking):
                self._left[asking] -= 1
                raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))
        return socket.socket(*arguments)

    def __getattr__(self, name):
        return getattr(socket, name)


@pytest.fixture
def scarce(monkeypatch, caplog):
    made = Scarce()
    for module in (dialled_stream, listener):
        monkeypatch.setattr(module, "socket", made)
    yield made
    assert made.is_over
    assert not [one for one in caplog.records if one.levelno > logging.WARNING]


@pytest.fixture(scope="module")
def server(source_master, tmp_path_factory):
    with ProcessGroup() as group:
        start_server(group, source_master, tmp_path_factory.mktemp("server") / "log")
        yield group


def test_an_import_that_got_no_socket_is_dialled_again(relays, talkers, scarce):
    source, sink = relays("source"), relays("sink", retry_shortest=0.5)
    scarce.refuse("dialled_link", 2)
    connect(source, sink, state=LinkState.UNREACHABLE)
    assert (
        sink.link().reason == "no socket available on this gateway's computer: Too many open files"
    )
    wait_for(sink, LinkState.ACTIVE)


def test_the_master_is_called_again_after_calls_that_got_no_socket(sides, scarce):
    source, sink = sides
    scarce.refuse("xmlrpc_client", 12)
    connect(source, sink, ("/chatter", "/big", "/latched"))
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
        assert number_of_good(subscriber) >= 0


@pytest.mark.parametrize("module", ["xmlrpc_client", "subscription"])
def test_a_publisher_is_subscribed_once_there_is_a_socket(sides, scarce, module):
    source, sink = sides
    connect(source, sink)
    scarce.refuse(module, 4)
    with Subscriber(sink, "/source/talker1", "/chatter") as subscriber:
        first = number_of_good(subscriber)
        assert [number_of_good(subscriber) for _ in range(5)] == list(range(first + 1, first + 6))


def test_a_proxy_that_got_no_port_is_shown_later(relays, talkers, scarce):
    source, sink = relays("source"), relays("sink", retry_shortest=0.5)
    scarce.refuse("listener", 2)
    connect(source, sink, state=LinkState.PENDING)
    wait_until(lambda: "Too many open files" in sink.link().reason, "why it is not shown", 5)
    wait_for(sink, LinkState.ACTIVE)


@pytest.mark.parametrize("module", ["xmlrpc_client", "dialled_link"])
def test_a_parameter_is_copied_once_there_is_a_socket(
    relays, source_master, sink_master, scarce, module
):
    source, sink = relays("source"), relays("sink")
    source_master.set_param("/scarce", 7)
    scarce.refuse(module, 6)
    source.relay.apply({Export("/scarce", ANY, "", "sink", subject=Subject.PARAMETER)}, set())
    sink.relay.apply(
        set(),
        {Import("/scarce", ANY, ANY, "source", "", source.address, subject=Subject.PARAMETER)},
    )
    wait_until(lambda: sink.state() == [LinkState.ACTIVE], "the parameter", 10)
    assert sink_master.proxy().getParam("/scarce") == 7


@pytest.mark.parametrize("module", ["service_export", "dialled_link", "xmlrpc_client"])
def test_a_call_without_a_socket_fails_and_the_next_one_does_not(relays, server, scarce, module):
    source, sink = relays("source"), relays("sink")
    connect_service(source, sink)
    scarce.refuse(module, 1)
    with Client(sink) as client:
        assert "Too many open files" in client.header["error"]
    with Client(sink) as client:
        assert client.call("hello") == "hello"
