"""Connections that we open, and watching whether the peer is alive."""

import socket

from tcpros.reactor import Reactor
from tcpros.resolver import DialError
from tcpros.stream import Stream
from tcpros.tls_socket import Tls


class DialledStream(Stream):
    """A connection that we open, and on which we speak first.

    Args:
        reactor: the loop.
        peer: the other end, for log lines.
        request: sent once the connection is established.
        tls: encrypts the connection; None for plain TCP.

    Raises:
        DialError: no socket is available.
    """

    def __init__(self, reactor: Reactor, peer: str, request: bytes, tls: Tls | None = None) -> None:
        try:
            sock = socket.socket(
                socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
            )
        except OSError as error:
            raise DialError(
                f"no socket available on this gateway's computer: {error.strerror}"
            ) from None
        super().__init__(reactor, sock, peer, tls.dialled(sock) if tls else None)
        self._request = request

    def connected(self) -> None:
        """Sends the request."""
        self.send(self._request)


def watch_liveness(sock: socket.socket) -> None:
    """Makes the kernel close the connection if the peer acknowledges nothing for eight seconds.

    An idle connection is probed every two seconds. Data that the peer's host does not acknowledge, or that the peer
    does not read, closes it after seven. The process is never woken for this.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 2)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 2)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 7000)  # type: ignore[attr-defined]
