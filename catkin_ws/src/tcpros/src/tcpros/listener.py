"""A listening TCP port in the reactor."""

import contextlib
import errno
import select
import socket
from collections.abc import Callable

from tcpros.reactor import Reactor

_IN = select.EPOLLIN
_EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)

_OPTION: int = socket.TCP_CONGESTION  # type: ignore[attr-defined]

_UNPACED = b"reno"
"""Congestion control for peers on this machine, where no network needs protection; every kernel has it.

If the system default is BBR, it would pace local connections too, with timers that double the relays' CPU time
per megabyte. A connection that starts with BBR keeps these timers. So every connection starts with this one and is
switched to the system default once the peer turns out to be on another machine.
"""


class Listener:
    """A listening socket in the reactor."""

    def __init__(
        self,
        reactor: Reactor,
        host: str,
        port: int,
        accepted: Callable[[socket.socket, str], None],
        backlog: int = 128,
    ) -> None:
        self._reactor = reactor
        self._accepted = accepted
        self._socket = socket.socket(
            socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
        )
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._socket.bind((host, port))
        except OSError:
            self._socket.close()
            raise
        self._usual = _chosen(self._socket)
        _choose(self._socket, _UNPACED)
        self._socket.listen(backlog)
        self.port = int(self._socket.getsockname()[1])  #: the port number

    def start(self) -> None:
        """Starts accepting connections."""
        self._reactor.add(self._socket.fileno(), self, _IN)

    def ready(self, events: int) -> None:
        """Accepts a connection."""
        try:
            sock, address = self._socket.accept()
        except OSError as error:
            if error.errno in _EXHAUSTED:  # epoll would report the same event forever
                self._reactor.change(self._socket.fileno(), 0)
                self._reactor.call_later(1.0, self._resume)
            return
        try:
            if sock.getsockname()[0] != address[0]:
                _choose(sock, self._usual)
            self._accepted(sock, f"{address[0]}:{address[1]}")
        except Exception as error:  # noqa: BLE001 - logged; it costs this connection, not the port
            sock.close()
            self._reactor.faults.take(error)

    def close(self, reason: str) -> None:
        """Stops listening; a second call does nothing."""
        if self._socket.fileno() >= 0:
            self._reactor.remove(self._socket.fileno())
            self._socket.close()

    def _resume(self) -> None:
        if self._socket.fileno() >= 0:
            self._reactor.change(self._socket.fileno(), _IN)


def _chosen(sock: socket.socket) -> bytes:
    return sock.getsockopt(socket.IPPROTO_TCP, _OPTION, 16).rstrip(b"\0")


def _choose(sock: socket.socket, congestion_control: bytes) -> None:
    with contextlib.suppress(OSError):  # the kernel or the administrator may forbid it
        sock.setsockopt(socket.IPPROTO_TCP, _OPTION, congestion_control)
