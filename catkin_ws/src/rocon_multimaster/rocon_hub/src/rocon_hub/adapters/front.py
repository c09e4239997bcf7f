"""The port of a hub with a password: connects only those clients to Redis that prove they know the password."""

import asyncio
import contextlib
import errno
import logging
import resource
import socket
import ssl
import threading
from collections import deque
from collections.abc import Callable

from rocon_hub_protocol.core.admission import LONGEST_LINE, UNPROVEN, HubSide
from rocon_hub_protocol.core.cpace import ProofError

HANDSHAKE_TIME = 5.0
"""Timeout for each line of a client's proof [s]."""

MAX_UNPROVEN = 2048
"""Maximum number of unauthenticated clients; one more closes the oldest. A thousand gateways may reconnect at once.

If the process may open only few files, the maximum is a quarter of that limit.
"""

NO_FILE_LEFT = (errno.EMFILE, errno.ENFILE)

ROOM_PERIOD = 0.02
"""Retry interval for accepting a client when no file descriptor is free [s]."""

BACKLOG = 511
"""Maximum number of clients waiting to be accepted."""

_KEEPALIVE = {socket.TCP_KEEPIDLE: 10, socket.TCP_KEEPINTVL: 5, socket.TCP_KEEPCNT: 3}


class Front:
    """Listens from its creation until `close`, in a separate thread.

    Args:
        port: the hub's port.
        target: path of the Unix socket of its Redis.
        password: returns the current password.
        context: for TLS; None for plain TCP.

    Raises:
        OSError: the port is not available.
    """

    def __init__(
        self,
        port: int,
        target: str,
        password: Callable[[], str],
        context: ssl.SSLContext | None,
    ) -> None:
        self.target, self.password = target, password
        self._logger = logging.getLogger("rosout")
        self._sockets = _listening(port)
        self._context = context
        self._most = self._most_unproven()
        self._clients: set[Client] = set()
        self._unproven: dict[Client, None] = {}
        self._waiting: deque[Client] = deque()
        self._told: set[str] = set()
        self._end = asyncio.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="hub front", daemon=True)
        self._thread.start()

    def _most_unproven(self) -> int:
        files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        if files == resource.RLIM_INFINITY or files // 4 >= MAX_UNPROVEN:
            return MAX_UNPROVEN
        self._logger.warning(
            "the hub may have %d files open, four of them for each gateway, so at most %d gateways can join; "
            "for more raise the hard limit (ulimit -Hn)", files, files // 4,
        )  # fmt: skip
        return files // 4

    def close(self) -> None:
        """Closes the port and all connections."""
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join()

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            for one in self._sockets:
                one.close()
            self._loop.close()

    async def _serve(self) -> None:
        for one in self._sockets:
            one.setblocking(False)
            self._loop.create_task(self._accept(one))
        await self._end.wait()
        for client in self._clients:
            client.drop()
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _accept(self, listening: socket.socket) -> None:
        """Accepts clients. Each counts as unauthenticated from now on, even before its TLS handshake."""
        while True:
            try:
                connection, address = await self._loop.sock_accept(listening)
            except OSError as error:
                if error.errno in NO_FILE_LEFT:
                    self._drop_oldest()
                    await asyncio.sleep(ROOM_PERIOD)
                continue
            client = Client(self, self._loop, connection, address[0])
            self._clients.add(client)
            self._unproven[client] = None
            self._loop.create_task(self._open(client, connection))
            if len(self._unproven) > self._most:
                self._drop_oldest()
            await asyncio.sleep(0)

    async def _open(self, client: "Client", connection: socket.socket) -> None:
        patience = HANDSHAKE_TIME if self._context else None
        opened = False
        try:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for option, value in _KEEPALIVE.items():
                connection.setsockopt(socket.IPPROTO_TCP, option, value)
            await self._loop.connect_accepted_socket(
                lambda: client,
                connection,
                ssl=self._context,
                ssl_handshake_timeout=patience,
                ssl_shutdown_timeout=patience,
            )
            opened = True
        except OSError:  # no TLS, timeout, or disconnected
            return
        finally:
            if not opened:
                connection.close()
                self.left(client)

    def _drop_oldest(self) -> None:
        for client in list(self._unproven)[:1]:
            self.settled(client)
            client.drop()

    def wait(self, client: "Client") -> None:
        """Queues a client. Proofs start one at a time, so that those in progress finish first."""
        self._waiting.append(client)
        if len(self._waiting) == 1:
            self._loop.call_soon(self._next)

    def _next(self) -> None:
        while self._waiting and self._waiting[0].has_left:
            self._waiting.popleft()
        if self._waiting:
            client = self._waiting.popleft()
            if self._waiting:
                self._loop.call_soon(self._next)
            client.begin()

    def settled(self, client: "Client") -> None:
        """Called when a client has proved the password or disconnected."""
        self._unproven.pop(client, None)

    def left(self, client: "Client") -> None:
        """Removes a disconnected client."""
        self.settled(client)
        self._clients.discard(client)

    def refused(self, host: str) -> None:
        """Logs that a host has a different password, once until it has ours."""
        if host not in self._told and len(self._told) < MAX_UNPROVEN:
            self._told.add(host)
            self._logger.warning("a client at %s does not know the hub's password", host)

    def admitted(self, host: str) -> None:
        """Called when a client at `host` has proved the password."""
        self._told.discard(host)


class End(asyncio.Protocol):
    """One end of two joined connections; forwards everything it receives to the other end."""

    def __init__(self) -> None:
        self.transport: asyncio.Transport | None = None
        self.other: End | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Stores the new connection."""
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        """Forwards received data."""
        if self.other and self.other.transport:
            self.other.transport.write(data)

    def pause_writing(self) -> None:
        """Stops reading from the other side while this peer does not read, so that Redis' own limits apply."""
        if self.other and self.other.transport:
            self.other.transport.pause_reading()

    def resume_writing(self) -> None:
        """Resumes reading from the other side."""
        if self.other and self.other.transport:
            self.other.transport.resume_reading()

    def connection_lost(self, error: Exception | None) -> None:
        """Closes the other side too."""
        if self.other and self.other.transport:
            self.other.transport.close()
        self.other = None


class Client(End):
    """A client of the hub, from its first byte on."""

    def __init__(self, front: Front, loop: asyncio.AbstractEventLoop, connection: socket.socket, host: str) -> None:
        super().__init__()
        self._front, self._loop, self._connection, self._host = front, loop, connection, host
        self._line = self._first = b""
        self._side: HubSide | None = None
        self._joining: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Starts the timeout for the first line."""
        super().connection_made(transport)
        self._expect()

    def data_received(self, data: bytes) -> None:
        """Handles lines of the proof; afterwards forwards received data."""
        if self.other:
            super().data_received(data)
            return
        self._line += data
        if self._joining or len(self._line) > LONGEST_LINE:
            self.give_up()  # it sends more without waiting for the answer
        elif self._line.endswith(b"\r\n"):
            line, self._line = self._line, b""
            self._take(line)

    def connection_lost(self, error: Exception | None) -> None:
        """Closes the other side too."""
        self._timer.cancel()
        self._front.left(self)
        super().connection_lost(error)

    def give_up(self) -> None:
        """Closes the connection."""
        if self.transport:
            self.transport.close()

    def drop(self) -> None:
        """Closes the connection immediately, discarding unsent data and a pending TLS handshake."""
        if self.transport:
            self.transport.abort()
            return
        with contextlib.suppress(OSError):  # not connected any more
            self._connection.shutdown(socket.SHUT_RDWR)  # this ends the TLS handshake

    @property
    def has_left(self) -> bool:
        """Whether the connection is closed, or about to be."""
        return self.transport is None or self.transport.is_closing()

    def begin(self) -> None:
        """Answers the first line."""
        assert self.transport is not None
        try:
            self._side = HubSide(self._front.password(), self._first)
        except ProofError:
            self._refuse(UNPROVEN)
            return
        self.transport.write(self._side.answer)
        self._expect()

    def _expect(self) -> None:
        self._timer = self._loop.call_later(HANDSHAKE_TIME, self.give_up)

    def _take(self, line: bytes) -> None:
        self._timer.cancel()
        if not self._first:
            self._first = line
            self._front.wait(self)
        elif self._side is None:
            self.give_up()  # it sends more without waiting for the answer
        else:
            self._judge(self._side, line)

    def _judge(self, side: HubSide, line: bytes) -> None:
        try:
            proven, answer = side.verdict(line)
        except ProofError:
            self._refuse(UNPROVEN)
            return
        if proven:
            self._front.admitted(self._host)
            self._joining = self._loop.create_task(self._join(answer))
        else:
            self._front.refused(self._host)
            self._refuse(answer)

    def _refuse(self, answer: bytes) -> None:
        assert self.transport is not None
        self.transport.write(answer)
        self.give_up()

    async def _join(self, answer: bytes) -> None:
        assert self.transport is not None
        end = End()
        try:
            await self._loop.create_unix_connection(lambda: end, self._front.target)
        except OSError:  # Redis has died or is starting
            self.give_up()
            return
        self._front.settled(self)
        if self.transport.is_closing():
            assert end.transport is not None
            end.transport.close()
            return
        self.other, end.other = end, self
        self.transport.write(answer)


def _listening(port: int) -> list[socket.socket]:
    """Returns sockets that listen on all IPv4 addresses, and on all IPv6 addresses if available."""
    sockets = [socket.create_server(("", port), backlog=BACKLOG)]
    if socket.has_ipv6:
        try:
            sockets.append(socket.create_server(("::", port), family=socket.AF_INET6, backlog=BACKLOG))
        except OSError:  # IPv6 is built in but disabled
            return sockets
    return sockets
