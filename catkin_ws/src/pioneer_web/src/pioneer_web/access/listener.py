"""Accepts connections for an HTTP server: with TLS, time-outs, and a limit for those that send no request."""

import asyncio
import contextlib
import socket
import ssl
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from aiohttp import web

from pioneer_web.access.admission import PATIENCE, Admission

RETRY = 0.5
"""Time until the next attempt if no connection can be accepted, usually for lack of descriptors [s]."""
BACKLOG = 2048
"""Maximum number of connections that wait to be accepted."""


class Listener:
    """Connections of clients, by the protocol object that aiohttp has for each.

    Args:
        server: makes that object for a connection.
        host, port: address to listen on.
        context: of TLS; None for no TLS.
        on_fault: called with the reason if a connection cannot be accepted.
        admission: limits the connections that have no request, a handshake among them.
        patience: time-out of a handshake, and for the next request [s].

    Raises:
        OSError: the address cannot be used.
    """

    def __init__(
        self,
        server: Callable[[], asyncio.Protocol],
        host: str,
        port: int,
        context: ssl.SSLContext | None,
        on_fault: Callable[[str], None],
        admission: Admission | None = None,
        patience: float = PATIENCE,
    ) -> None:
        self._server = server
        self._context = context
        self._on_fault = on_fault
        self._admission = admission or Admission()
        self._patience = patience
        self._connections: dict[asyncio.BaseProtocol, _Connection] = {}
        self._sockets = [_bound(*address) for address in _addresses(host, port)]

    @property
    def addresses(self) -> list[tuple[str, int]]:
        """The addresses that it listens on, with their ports."""
        return [listening.getsockname()[:2] for listening in self._sockets]

    async def run(self) -> None:
        """Accepts connections in an endless loop; closes the listening sockets when it is cancelled."""
        try:
            await asyncio.gather(*(self._accept(listening) for listening in self._sockets))
        finally:
            for listening in self._sockets:
                listening.close()

    @contextlib.contextmanager
    def answering(self, request: web.BaseRequest) -> Iterator[None]:
        """While in this context, the connection of this request is not idle."""
        connection = self._connections.get(request.protocol)
        if connection is None:  # it has just ended
            yield
            return
        connection.idle_since = None
        try:
            yield
        finally:
            connection.idle_since = time.monotonic()

    def becomes_socket(self, request: web.BaseRequest) -> None:
        """Exempts the connection of a request that becomes a WebSocket from limits and time-outs."""
        if connection := self._connections.get(request.protocol):
            self._admission.remove(connection)
            connection.end_checks()

    async def _accept(self, listening: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, address = await loop.sock_accept(listening)
            except OSError as error:
                self._on_fault(error.strerror or str(error))
                await asyncio.sleep(RETRY)
                continue
            # Between two connections, the loop serves those that are there: a flood must not delay a stop.
            await asyncio.sleep(0)
            connection = _Connection(self._server(), self._forget, self._patience)
            self._connections[connection.http] = connection
            self._admission.add(connection, address[0])
            connection.opening = loop.create_task(self._open(connection, accepted))

    async def _open(self, connection: "_Connection", accepted: socket.socket) -> None:
        """Hands an accepted socket to its connection, after TLS's handshake."""
        loop = asyncio.get_running_loop()
        patience = self._patience if self._context else None
        try:
            await loop.connect_accepted_socket(
                lambda: connection, accepted, ssl=self._context, ssl_handshake_timeout=patience
            )
        except OSError:  # no handshake: the client is gone, slow, or does not speak TLS
            accepted.close()
        finally:
            connection.opening = None
            if connection.transport is None:
                self._forget(connection)

    def _forget(self, connection: "_Connection") -> None:
        self._admission.remove(connection)
        self._connections.pop(connection.http, None)


class _Connection(asyncio.Protocol):
    """Passes everything to aiohttp's protocol object, and ends the connection if no request comes."""

    def __init__(
        self, http: asyncio.Protocol, on_end: Callable[["_Connection"], None], patience: float
    ) -> None:
        self.http = http
        self.transport: asyncio.BaseTransport | None = None
        self.opening: asyncio.Task[None] | None = None
        #: since when no request is being answered (monotonic) [s]; None while one is
        self.idle_since: float | None = time.monotonic()
        self._on_end = on_end
        self._patience = patience
        self._check: asyncio.TimerHandle | None = None
        # Without a call of ours for each piece of data.
        self.data_received = http.data_received  # type: ignore[assignment, method-assign]

    @property
    def is_idle(self) -> bool:
        """Whether no request is being answered."""
        return self.idle_since is not None

    def abort(self) -> None:
        """Ends the connection at once, also during its handshake."""
        if isinstance(self.transport, asyncio.Transport):
            self.transport.abort()
        elif self.opening is not None:
            self.opening.cancel()

    def end_checks(self) -> None:
        """Ends the time-outs."""
        if self._check is not None:
            self._check.cancel()
            self._check = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begins to wait for the first request."""
        self.transport = transport
        self.idle_since = time.monotonic()
        self._check_after(self._patience)
        self.http.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Ends the connection."""
        self.end_checks()
        self._on_end(self)
        self.http.connection_lost(exc)

    def eof_received(self) -> bool | None:
        """Passes it on."""
        return self.http.eof_received()

    def pause_writing(self) -> None:
        """Passes it on."""
        self.http.pause_writing()

    def resume_writing(self) -> None:
        """Passes it on."""
        self.http.resume_writing()

    def _check_after(self, seconds: float) -> None:
        self._check = asyncio.get_running_loop().call_later(seconds, self._abort_if_idle)

    def _abort_if_idle(self) -> None:
        """Ends the connection if it has been idle for too long."""
        if self.idle_since is None:
            self._check_after(self._patience)
            return
        left = self.idle_since + self._patience - time.monotonic()
        if left > 0:
            self._check_after(left)
        else:
            self.abort()


def tls_context(certificate: Path, key: Path) -> ssl.SSLContext:
    """Returns a server's TLS context without session tickets.

    A ticket makes a connection readable although no data follows. Clients that then read from a blocking socket, such
    as the synchronous client of websockets, hang if they write at the same time.

    Raises:
        OSError: a file cannot be read, or has no certificate or key.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    context.num_tickets = 0  # type: ignore[attr-defined]
    return context


def _addresses(host: str, port: int) -> list[tuple[socket.AddressFamily, tuple[str, int]]]:
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    return list(dict.fromkeys((family, address[:2]) for family, _, _, _, address in found))


def _bound(family: socket.AddressFamily, address: tuple[str, int]) -> socket.socket:
    listening = socket.create_server(address, family=family, backlog=BACKLOG)
    listening.setblocking(False)
    return listening
