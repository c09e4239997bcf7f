"""A listening port of the relay."""

import logging
import select
import socket

import pytest

from tcpros.listener import Listener
from tcpros.reactor import Reactor


def congestion_control(sock: socket.socket) -> bytes:
    return sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, 16).rstrip(b"\0")


@pytest.mark.parametrize("peer", ["127.0.0.1", "127.0.0.2"])
def test_only_peers_on_this_machine_are_sent_to_without_pacing(peer: str) -> None:
    """Between processes on one machine, BBR's timers doubled the CPU time of two relays per megabyte."""
    with socket.socket() as fresh:
        usual = congestion_control(fresh)
    accepted: list[bytes] = []

    def take(sock: socket.socket, _: str) -> None:
        accepted.append(congestion_control(sock))
        sock.close()

    listener = Listener(Reactor(logging.getLogger()), "127.0.0.1", 0, take)
    with socket.create_connection(("127.0.0.1", listener.port), source_address=(peer, 0)):
        listener.ready(select.EPOLLIN)
    listener._socket.close()
    assert accepted == [b"reno" if peer == "127.0.0.1" else usual]


def test_an_exception_in_accepting_costs_that_connection_and_not_the_port() -> None:
    """The port of a gateway was closed for good."""
    reactor = Reactor(logging.getLogger())
    peers = list[str]()

    def take(sock: socket.socket, peer: str) -> None:
        peers.append(peer)
        if len(peers) == 1:
            raise RuntimeError("as asked")
        sock.close()
        reactor.stop()

    listener = Listener(reactor, "127.0.0.1", 0, take)
    listener.start()
    reactor.call_later(20.0, reactor.stop)
    with (
        socket.create_connection(("127.0.0.1", listener.port)),
        socket.create_connection(("127.0.0.1", listener.port)),
    ):
        reactor.run()
    assert len(peers) == 2
