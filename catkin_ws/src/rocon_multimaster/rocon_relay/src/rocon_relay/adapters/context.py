"""What the parts of one relay share."""

import logging
from collections.abc import Callable
from typing import Protocol

from rocon_relay.core.connection import RelayConfig
from rocon_relay.core.latency import RoundTrips
from rocon_relay.core.option import LinkOptions
from tcpros.adapters.reactor import Reactor
from tcpros.adapters.resolver import Resolver
from tcpros.adapters.tls import Certificates
from tcpros.adapters.tls_socket import Tls
from tcpros.adapters.xmlrpc_client import Server
from tcpros.core.backlog import Backlog


class Context:
    """Configuration, loop, log, and the servers that are called."""

    def __init__(
        self,
        config: RelayConfig,
        reactor: Reactor,
        logger: logging.Logger,
        changed: Callable[[], None],
        certificates: Certificates | None,
    ) -> None:
        self.config = config  #: what the relay was given
        self.tls = Tls(certificates) if certificates else None  #: encrypts links; None if they are not encrypted
        self.reactor = reactor  #: its loop
        self.resolver = Resolver(reactor)  #: its look-ups
        self.logger = logger  #: where its log lines go
        self.changed = changed  #: to be called when the state of a link has changed
        self.round_trips: dict[str, RoundTrips] = {}  #: to other gateways, by name
        self.master = self.server(config.master_uri)  #: our master

    def server(self, uri: str) -> Server:
        """Returns a client of a node's or master's XML-RPC server."""
        return Server(self.reactor, self.resolver, uri, self.config.call_timeout)

    def round_trip(self, gateway: str, seconds: float) -> None:
        """Takes note of how long the way to a gateway and back took; 0 is no measurement."""
        if seconds > 0:
            self.round_trips.setdefault(gateway, RoundTrips()).add(seconds)

    def bound(self, backlog: Backlog, options: LinkOptions, drops_first: bool = False) -> None:
        """Sets the bounds of the queue towards one receiver; see `Backlog.bound`."""
        backlog.bound(options.queue_size or self.config.queue_size, self.config.queue_bytes, drops_first)


class Tenant(Protocol):
    """Who has taken over a connection, or a link that is not a topic's."""

    def ended(self, reason: str) -> None:
        """The connection is closed; called once."""


class Pause:
    """The pauses between attempts: each twice as long as the one before."""

    def __init__(self, config: RelayConfig) -> None:
        self._config = config
        self._next = config.retry_shortest

    def take(self) -> float:
        """Returns how long to wait now [s]."""
        pause, self._next = self._next, min(2 * self._next, self._config.retry_longest)
        return pause

    def reset(self) -> None:
        """Begins with the shortest again."""
        self._next = self._config.retry_shortest
