"""The port of a hub with a password: connects only those clients to Redis that prove they know the password."""

import asyncio
import contextlib
import errno
import logging
import resource
import socket
import ssl
import threading
import time
from collections.abc import Callable

from rocon_hub.guess import LONGEST_DELAY, MEMORY, FailingHosts
from rocon_hub_protocol.admission import BUSY, LONGEST_LINE, UNPROVEN, HubSide
from rocon_hub_protocol.cpace import ProofError
from tcpros.loop_faults import LoopFaults

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
        self._target, self._password = target, password
        self._logger = logging.getLogger("rosout")
        self._faults = LoopFaults(self._logger, "the hub's port")
        self._sockets = _listening(port)
        self._context = context
        self._most = self._most_unproven()
        self._clients: set[Client] = set()
        self._unproven: dict[Client, None] = {}
        self._turn = asyncio.Lock()
        self._failing = FailingHosts()
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
                # Whatever is missing, such as memory: the next attempt would fail at once, and block all clients.
                await asyncio.sleep(ROOM_PERIOD)
                continue
            with self._faults:
                self._take(connection, address[0])
            await asyncio.sleep(0)

    def _take(self, connection: socket.socket, host: str) -> None:
        client = Client(self._loop, connection, self._left)
        self._clients.add(client)
        self._unproven[client] = None
        client.admission = self._loop.create_task(self._admit(client, connection, host))
        if len(self._unproven) > self._most:
            self._drop_oldest()

    def _drop_oldest(self) -> None:
        for client in list(self._unproven)[:1]:
            self._unproven.pop(client)
            client.drop()

    def _left(self, client: "Client") -> None:
        """Removes a disconnected client."""
        self._unproven.pop(client, None)
        self._clients.discard(client)

    async def _admit(self, client: "Client", connection: socket.socket, host: str) -> None:
        """Opens a client's connection and joins it to Redis if it proves the password."""
        patience = HANDSHAKE_TIME if self._context else None
        opened = False
        try:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for option, value in _KEEPALIVE.items():
                connection.setsockopt(socket.IPPROTO_TCP, option, value)
            transport, _ = await self._loop.connect_accepted_socket(
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
                self._left(client)
        try:
            answer, is_proven = await self._judge(client, host)
            if is_proven:
                _, end = await self._loop.create_unix_connection(End, self._target)
                self._unproven.pop(client, None)
                client.other, end.other = end, client
            transport.write(answer)
            if not is_proven:
                transport.close()
        except OSError:  # it is too slow, or Redis has died or is starting
            transport.close()
        except Exception as error:  # noqa: BLE001 - the outermost of this task; it is logged
            self._faults.take(error)
            transport.close()

    async def _judge(self, client: "Client", host: str) -> tuple[bytes, bool]:
        """Returns the last answer to a client, and whether it has proved the password."""
        first = await client.line()
        try:
            async with self._turn:
                # Proofs start one at a time, so that those in progress finish first.
                await asyncio.sleep(0)
                side = HubSide(self._password(), first)
            proof = await client.line(side.answer)
            failing = self._failing.get(host)
            if failing and not await failing.wait():
                return BUSY, False
            is_proven, answer = side.verdict(proof)
        except ProofError:
            return UNPROVEN, False
        if not is_proven and self._failing.fail(host, time.monotonic()):
            self._logger.warning("a client at %s does not know the hub's password", host)
            self._failing.report(host)
            self._loop.call_later(MEMORY, self._report, host)
        return answer, is_proven

    def _report(self, host: str) -> None:
        """Logs how often a host has failed since the last report, and repeats this until it fails no more."""
        number = self._failing.report(host)
        if number:
            self._logger.warning(
                "clients at %s failed to prove the hub's password another %d times within %g s; "
                "one proof from there is checked every %g s",
                host,
                number,
                MEMORY,
                LONGEST_DELAY,
            )
        if self._failing.get(host):
            self._loop.call_later(MEMORY, self._report, host)


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
    """A client of the hub, from its first byte on.

    Args:
        loop: the event loop.
        connection: its socket.
        left: called once it has disconnected.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        connection: socket.socket,
        left: Callable[["Client"], object],
    ) -> None:
        super().__init__()
        self.admission: asyncio.Task[None] | None = (
            None  #: ends when the client is admitted or refused
        )
        self._loop, self._connection, self._left = loop, connection, left
        self._received = b""
        self._line: asyncio.Future[bytes] = loop.create_future()

    async def line(self, answer: bytes = b"") -> bytes:
        """Sends our answer, if any, and returns the client's next line; raises TimeoutError."""
        if answer and self.transport:
            self._line = self._loop.create_future()
            self.transport.write(answer)
        async with asyncio.timeout(HANDSHAKE_TIME):
            return await self._line

    def data_received(self, data: bytes) -> None:
        """Takes lines of the proof; afterwards forwards received data."""
        if self.other:
            super().data_received(data)
            return
        self._received += data
        if self._line.done() or len(self._received) > LONGEST_LINE:
            if self.transport:
                self.transport.close()  # it sends more without waiting for the answer
        elif self._received.endswith(b"\r\n"):
            self._line.set_result(self._received)
            self._received = b""

    def connection_lost(self, error: Exception | None) -> None:
        """Closes the other side too."""
        if self.admission:
            self.admission.cancel()
        self._left(self)
        super().connection_lost(error)

    def drop(self) -> None:
        """Closes the connection immediately, discarding unsent data and a pending TLS handshake."""
        if self.transport:
            self.transport.abort()
            return
        with contextlib.suppress(OSError):  # not connected any more
            self._connection.shutdown(socket.SHUT_RDWR)  # this ends the TLS handshake


def _listening(port: int) -> list[socket.socket]:
    """Returns sockets that listen on all IPv4 addresses, and on all IPv6 addresses if available."""
    sockets = [socket.create_server(("", port), backlog=BACKLOG)]
    if socket.has_ipv6:
        try:
            sockets.append(
                socket.create_server(("::", port), family=socket.AF_INET6, backlog=BACKLOG)
            )
        except OSError:  # IPv6 is built in but disabled
            return sockets
    return sockets
