"""Limits unfinished HTTP requests: clients that connect and send nothing must not keep others out."""

import asyncio
from collections import Counter
from typing import Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

MOST, MOST_OF_HOST = 512, 256
"""Maximum number of HTTP connections, of all hosts and of one; another one closes the oldest that has no request."""
PATIENCE = 10.0
"""Time-out for a request's header, and for the next one on the same connection [s]."""


class Admission:
    """The HTTP connections of a server. Connections that have become WebSockets no longer count."""

    def __init__(self, most: int = MOST, most_of_host: int = MOST_OF_HOST) -> None:
        self._most, self._most_of_host = most, most_of_host
        #: from the oldest to the newest, with the client's host
        self._hosts: dict[Any, str] = {}
        self._counts = Counter[str]()

    def add(self, connection: Any, host: str) -> None:
        """Adds a connection; closes an idle one if there are too many."""
        self._hosts[connection] = host
        self._counts[host] += 1
        if self._counts[host] > self._most_of_host:
            self._close_idle(host)
        elif len(self._hosts) > self._most:
            (busiest, _), *_ = self._counts.most_common(1)
            self._close_idle(busiest)

    def remove(self, connection: Any) -> None:
        """Removes a connection; no effect if it is gone already."""
        host = self._hosts.pop(connection, None)
        if host is None:
            return
        self._counts[host] -= 1
        if not self._counts[host]:
            del self._counts[host]

    def _close_idle(self, host: str) -> None:
        for connection, own in self._hosts.items():
            if own == host and connection.is_idle:
                self.remove(connection)
                connection.transport.abort()
                return


def admitted_protocol(admission: Admission, patience: float = PATIENCE) -> type[asyncio.Protocol]:
    """Returns uvicorn's HTTP protocol with time-outs for unfinished requests and a limit of connections."""

    class Admitted(AutoHTTPProtocol):  # type: ignore[valid-type, misc]
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            self._checked: Any = None
            admission.add(self, self.client[0] if self.client else "")
            self._check = asyncio.get_running_loop().call_later(patience, self._close_if_idle)

        def connection_lost(self, exc: Exception | None) -> None:
            self._check.cancel()
            admission.remove(self)
            super().connection_lost(exc)

        def handle_websocket_upgrade(self, *arguments: Any) -> None:
            self._check.cancel()
            admission.remove(self)
            super().handle_websocket_upgrade(*arguments)

        @property
        def is_idle(self) -> bool:
            """Whether no request is being answered."""
            return self.cycle is None or bool(self.cycle.response_complete)

        def _close_if_idle(self) -> None:
            """Closes the connection if it has been without a new request since the last check."""
            if self.is_idle and self.cycle is self._checked:
                self.transport.abort()
                return
            self._checked = self.cycle
            self._check = asyncio.get_running_loop().call_later(patience, self._close_if_idle)

    return Admitted
