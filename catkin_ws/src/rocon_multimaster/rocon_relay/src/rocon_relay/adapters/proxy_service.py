"""One service of a proxy node and its clients."""

from typing import Protocol

from rocon_relay.adapters.context import Context, Tenant
from rocon_relay.adapters.registration import Node, Nodes, Owner, Registration
from rocon_relay.core.connection import Import
from tcpros.adapters.stream import Stream


class Call(Tenant, Protocol):
    """A relayed client connection."""

    def fail(self, reason: str) -> None:
        """Ends the connection; the client gets an error if it waits for a response."""


class ServiceOwner(Owner, Protocol):
    """The importing end behind a service."""

    def called(self, client: Stream, fields: dict[str, str]) -> Call:
        """Called with a new client; returns the call that owns its connection from now on."""


class ProxyService(Registration):
    """A service on our master that is provided by another gateway."""

    def __init__(self, context: Context, nodes: Nodes, owner: ServiceOwner, wanted: Import) -> None:
        super().__init__(context, nodes, owner, wanted.proxy)
        self.wanted = wanted  #: the import it belongs to; may be replaced by one with the same key
        self.calls: set[Call] = set()  #: the clients' connections
        self._host = context.config.host
        self._service_owner = owner

    def registering(self, node: Node) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method and arguments that register it."""
        return "registerService", (self.wanted.topic, self._uri(node), node.uri)

    def unregistering(self, node: Node) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method and arguments that unregister it."""
        return "unregisterService", (self.wanted.topic, self._uri(node))

    def call(self, client: Stream, fields: dict[str, str]) -> Call:
        """Accepts a client with its connection header."""
        call = self._service_owner.called(client, fields)
        if not client.is_closed:
            self.calls.add(call)
        return call

    def close_users(self) -> None:
        """Closes the connections of its users."""
        for call in tuple(self.calls):
            call.fail(f"{self.wanted.topic} is not relayed any more")

    def _uri(self, node: Node) -> str:
        return f"rosrpc://{self._host}:{node.port}"
