"""The hub's port where there is a password: only clients that prove the password are connected to Redis."""

import asyncio
import logging
import socket
import ssl
import threading
from collections import deque
from collections.abc import Callable

from rocon_hub_protocol.core.admission import LONGEST_LINE, UNPROVEN, HubSide
from rocon_hub_protocol.core.cpace import ProofError

HANDSHAKE_TIME = 5.0
"""For how long a client may take to say the next line of its proof [s]."""

MAX_UNPROVEN = 2048
"""Clients that have not proved it yet: a thousand gateways may come back at once. One more closes the oldest."""

BACKLOG = 511
"""So many clients may wait to be accepted."""

_KEEPALIVE = {socket.TCP_KEEPIDLE: 10, socket.TCP_KEEPINTVL: 5, socket.TCP_KEEPCNT: 3}


class Front:
    """Listens from its making until `close`, in a thread of its own.

    Args:
        port: the hub's.
        target: path of the Unix socket of its Redis.
        password: returns the password as it is now.
        context: for TLS; None for none.

    Raises:
        OSError: the port cannot be had.
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
        self._unproven: dict[Client, None] = {}
        self._waiting: deque[Client] = deque()
        self._told: set[str] = set()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="hub front", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Closes the port and all connections."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def _run(self) -> None:
        loop = self._loop
        patience = HANDSHAKE_TIME if self._context else None
        for one in self._sockets:
            serving = loop.create_server(
                lambda: Client(self, loop),
                sock=one,
                ssl=self._context,
                backlog=BACKLOG,
                ssl_handshake_timeout=patience,
                ssl_shutdown_timeout=patience,
            )
            loop.run_until_complete(serving)
        loop.run_forever()
        for task in asyncio.all_tasks(loop):
            task.cancel()
        for one in self._sockets:
            one.close()
        loop.run_until_complete(asyncio.sleep(0))
        loop.close()

    def arrived(self, client: "Client") -> None:
        """Takes note of somebody who has not proved anything yet."""
        self._unproven[client] = None
        if len(self._unproven) > MAX_UNPROVEN:
            next(iter(self._unproven)).give_up()

    def wait(self, client: "Client") -> None:
        """Has a client wait for its turn: one begins at a time, so that those that have begun come to an end first."""
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
        """Somebody has proved the password, or is gone."""
        self._unproven.pop(client, None)

    def refused(self, host: str) -> None:
        """Logs that a machine has another password, once until it has ours."""
        if host not in self._told and len(self._told) < MAX_UNPROVEN:
            self._told.add(host)
            self._logger.warning("a client at %s does not know the hub's password", host)

    def admitted(self, host: str) -> None:
        """Somebody at `host` knows the password."""
        self._told.discard(host)


class End(asyncio.Protocol):
    """One end of a connection that was joined to another: what comes here goes there."""

    def __init__(self) -> None:
        self.transport: asyncio.Transport | None = None
        self.other: End | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Takes the new connection."""
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        """Handles what has arrived."""
        if self.other and self.other.transport:
            self.other.transport.write(data)

    def pause_writing(self) -> None:
        """Stops reading the other side while this one is not read, so that Redis' own limits hold."""
        if self.other and self.other.transport:
            self.other.transport.pause_reading()

    def resume_writing(self) -> None:
        """Reads the other side again."""
        if self.other and self.other.transport:
            self.other.transport.resume_reading()

    def connection_lost(self, error: Exception | None) -> None:
        """Closes the other side too."""
        if self.other and self.other.transport:
            self.other.transport.close()
        self.other = None


class Client(End):
    """A client of the hub, from its first byte."""

    def __init__(self, front: Front, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._front, self._loop = front, loop
        self._line = self._first = b""
        self._side: HubSide | None = None
        self._host = ""
        self._joining: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Takes the new connection."""
        super().connection_made(transport)
        self._expect()
        self._host = transport.get_extra_info("peername")[0]
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in _KEEPALIVE.items():
            connection.setsockopt(socket.IPPROTO_TCP, option, value)
        self._front.arrived(self)

    def data_received(self, data: bytes) -> None:
        """Handles what has arrived."""
        if self.other:
            super().data_received(data)
            return
        self._line += data
        if self._joining or len(self._line) > LONGEST_LINE:
            self.give_up()  # it sends more before it was answered
        elif self._line.endswith(b"\r\n"):
            line, self._line = self._line, b""
            self._take(line)

    def connection_lost(self, error: Exception | None) -> None:
        """Closes the other side too."""
        self._timer.cancel()
        self._front.settled(self)
        super().connection_lost(error)

    def give_up(self) -> None:
        """Closes the connection."""
        if self.transport:
            self.transport.close()

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
            self.give_up()  # it sends more before it was answered
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
        except OSError:  # Redis has died, or is being started
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
    """Returns sockets that listen on all IPv4 addresses, and on all IPv6 ones if there is IPv6."""
    sockets = [socket.create_server(("", port), backlog=BACKLOG)]
    if socket.has_ipv6:
        try:
            sockets.append(socket.create_server(("::", port), family=socket.AF_INET6, backlog=BACKLOG))
        except OSError:  # built in, but switched off
            return sockets
    return sockets
