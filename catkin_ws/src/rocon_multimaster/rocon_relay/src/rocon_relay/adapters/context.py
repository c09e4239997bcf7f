"""State shared by the parts of one relay."""

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
    """Configuration, event loop, logger and clients for XML-RPC servers."""

    def __init__(
        self,
        config: RelayConfig,
        reactor: Reactor,
        logger: logging.Logger,
        changed: Callable[[], None],
        certificates: Certificates | None,
    ) -> None:
        self.config = config  #: the relay's configuration
        self.tls = Tls(certificates) if certificates else None  #: encrypts links; None if they are not encrypted
        self.reactor = reactor  #: the event loop
        self.resolver = Resolver(reactor)  #: resolves host names
        self.logger = logger  #: receives log lines
        self.changed = changed  #: must be called when the state of a link has changed
        self.round_trips: dict[str, RoundTrips] = {}  #: round trips to other gateways, by name
        self.master = self.server(config.master_uri)  #: our master

    def server(self, uri: str) -> Server:
        """Returns a client for the XML-RPC server of a node or master."""
        return Server(self.reactor, self.resolver, uri, self.config.call_timeout)

    def round_trip(self, gateway: str, seconds: float) -> None:
        """Records a round-trip time to a gateway [s]; 0 means no measurement and is ignored."""
        if seconds > 0:
            self.round_trips.setdefault(gateway, RoundTrips()).add(seconds)

    def bound(self, backlog: Backlog, options: LinkOptions, drops_first: bool = False) -> None:
        """Sets the limits of the send queue of one receiver; see `Backlog.bound`."""
        backlog.bound(options.queue_size or self.config.queue_size, self.config.queue_bytes, drops_first)


class Tenant(Protocol):
    """The owner of an accepted connection, or of a link that is not for a topic."""

    def ended(self, reason: str) -> None:
        """Called once when the connection has been closed."""


class Pause:
    """Exponential back-off: each pause between attempts is twice as long as the one before."""

    def __init__(self, config: RelayConfig) -> None:
        self._config = config
        self._next = config.retry_shortest

    def take(self) -> float:
        """Returns how long to wait now [s]."""
        pause, self._next = self._next, min(2 * self._next, self._config.retry_longest)
        return pause

    def reset(self) -> None:
        """Starts again with the shortest pause."""
        self._next = self._config.retry_shortest
