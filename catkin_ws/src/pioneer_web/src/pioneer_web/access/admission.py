"""Limits unfinished requests: clients that connect and send nothing must not keep others out."""

from collections import Counter
from typing import Protocol

MOST, MOST_OF_HOST = 512, 256
"""Maximum number of connections, of all hosts and of one; another one closes the oldest that has no request."""
PATIENCE = 10.0
"""Time-out for a TLS handshake, a request's header, and the next request on the same connection [s]."""


class Connection(Protocol):
    """A client's connection."""

    @property
    def is_idle(self) -> bool:
        """Whether no request is being answered."""

    def abort(self) -> None:
        """Ends it at once."""


class Admission:
    """The connections of a server from being accepted on. Those that have become WebSockets no longer count."""

    def __init__(self, most: int = MOST, most_of_host: int = MOST_OF_HOST) -> None:
        self._most = most
        self._most_of_host = most_of_host
        #: from the oldest to the newest, with the client's host
        self._hosts: dict[Connection, str] = {}
        self._counts = Counter[str]()

    def add(self, connection: Connection, host: str) -> None:
        """Adds a connection; ends an idle one if there are too many."""
        self._hosts[connection] = host
        self._counts[host] += 1
        if self._counts[host] > self._most_of_host:
            self._end_idle(host)
        elif len(self._hosts) > self._most:
            (busiest, _), *_ = self._counts.most_common(1)
            self._end_idle(busiest)

    def remove(self, connection: Connection) -> None:
        """Removes a connection; no effect if it is gone already."""
        host = self._hosts.pop(connection, None)
        if host is None:
            return
        self._counts[host] -= 1
        if not self._counts[host]:
            del self._counts[host]

    def _end_idle(self, host: str) -> None:
        for connection, its_host in self._hosts.items():
            if its_host == host and connection.is_idle:
                self.remove(connection)
                connection.abort()
                return
