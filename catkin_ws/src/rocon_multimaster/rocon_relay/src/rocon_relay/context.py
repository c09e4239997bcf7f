"""State shared by the parts of one relay."""

import logging
import time
from collections.abc import Callable

from rocon_relay.connection import RelayConfig
from rocon_relay.latency import RoundTrips
from rocon_relay.option import LinkOptions
from rocon_relay.path import Paths
from tcpros.backlog import Backlog
from tcpros.node_context import NodeContext, Pause
from tcpros.reactor import Reactor
from tcpros.tls import Certificates
from tcpros.tls_socket import Tls


class Context(NodeContext):
    """What proxy nodes share, and the configuration and round trips of the relay."""

    def __init__(
        self,
        config: RelayConfig,
        reactor: Reactor,
        logger: logging.Logger,
        changed: Callable[[], None],
        certificates: Certificates | None,
    ) -> None:
        timeouts = config.handshake_timeout, config.call_timeout
        super().__init__(
            reactor, config.master_uri, config.host, config.node_bind, logger, *timeouts
        )
        self.config = config  #: the relay's configuration
        self.tls = (
            Tls(certificates) if certificates else None
        )  #: encrypts links; None if they are not encrypted
        self.changed = changed  #: must be called when the state of a link has changed
        self.paths = Paths(time.monotonic)  #: the segment sizes for links
        self.round_trips: dict[str, RoundTrips] = {}  #: round trips to other gateways, by name

    def round_trip(self, gateway: str, seconds: float) -> None:
        """Records a round-trip time to a gateway [s]; 0 means no measurement and is ignored."""
        if seconds > 0:
            self.round_trips.setdefault(gateway, RoundTrips()).add(seconds)

    def bound(self, backlog: Backlog, options: LinkOptions, drops_first: bool = False) -> None:
        """Sets the limits of the send queue of one receiver; see `Backlog.bound`."""
        backlog.bound(
            options.queue_size or self.config.queue_size, self.config.queue_bytes, drops_first
        )

    def pause(self) -> Pause:
        """Returns new pauses between attempts."""
        return Pause(self.config.retry_shortest, self.config.retry_longest)
