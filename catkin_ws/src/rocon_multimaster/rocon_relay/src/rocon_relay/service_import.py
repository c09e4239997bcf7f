"""The importing end of a service: registers the proxy while the link is up; each client gets its own link."""

import dataclasses
from collections.abc import Callable
from typing import Any

from rocon_relay.connection import ANY, Import, LinkState, LinkStatus, Subject
from rocon_relay.context import Context
from rocon_relay.dialled_link import DialledLink, LinkOwner
from rocon_relay.proxy_node import ProxyNode, ProxyNodes
from rocon_relay.service_pipe import ServicePipe
from rocon_relay.standing_import import StandingImport
from tcpros.header import HeaderError, header_bytes
from tcpros.node_port import Ended
from tcpros.service_call import CallTotals
from tcpros.stream import Stream

MAX_CALLS = 256
"""Maximum number of concurrent clients of one service; one more is refused."""

MAX_REASON = 1000
"""Maximum length of a forwarded error text, which must fit into a header [characters]."""

PASSED_ON = ("type", "md5sum", "request_type", "response_type")
"""Fields of the server's connection header that are forwarded to the client."""


class ServiceImportEnd(StandingImport):
    """One imported service, from the first connection attempt to the last unregistration.

    The permanent link carries no data. While it is up, the far gateway is running and exports the service to us. Each
    client connection is relayed on its own link, opened when the client connects.
    """

    def __init__(
        self, context: Context, nodes: ProxyNodes, wanted: Import, ended: Callable[[], None]
    ) -> None:
        super().__init__(context, nodes, wanted, ended)
        self.calls: set[ImportedCall] = set()  #: the clients' connections
        self.totals = CallTotals()  #: counts of all calls

    def offered_by(self, node: ProxyNode) -> dict[str, Any]:
        """Returns the node's services."""
        return node.services

    def registering(self, node: ProxyNode) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method and arguments that register it."""
        return "registerService", (self.wanted.topic, node.service_uri, node.uri)

    def unregistering(self, node: ProxyNode) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method and arguments that unregister it."""
        return "unregisterService", (self.wanted.topic, node.service_uri)

    def close_users(self) -> None:
        """Closes the connections of all clients."""
        for call in tuple(self.calls):
            call.fail(f"{self.wanted.topic} is not relayed any more")

    def replace(self, wanted: Import) -> None:
        """Replaces the import by one with the same key and a new address; calls in progress continue if they can."""
        self.wanted = wanted
        self.redial("its address has changed")

    def status(self) -> LinkStatus:
        """Returns the status of the import."""
        totals = self.totals
        return LinkStatus(self._state, self._reason, len(self.calls), totals.calls, totals.bytes)

    def admit(self, client: Stream, fields: dict[str, str]) -> Ended:
        """Accepts a client with its connection header and starts relaying it."""
        call = ImportedCall(self._context, self, client, fields)
        if not self.registration.is_serving:
            call.fail(f"{self.wanted.topic} is not relayed any more")
        elif len(self.calls) >= MAX_CALLS:
            call.fail(f"{self.wanted.topic} has {MAX_CALLS} clients at a time and takes no more")
        else:
            call.dial()
        if not client.is_closed:
            self.calls.add(call)
        return call.ended

    def reached(self) -> None:
        """Called when a call has reached the server."""
        if self._state is LinkState.NO_SERVER:
            self._set(self.working_state, self.path_advice)

    def not_reached(self, reason: str) -> None:
        """Called when a call could not reach the server."""
        if self._state is self.working_state:
            self._set(LinkState.NO_SERVER, reason)


class ImportedCall(LinkOwner):
    """One client's connection and the link for its calls."""

    def __init__(
        self, context: Context, owner: ServiceImportEnd, client: Stream, fields: dict[str, str]
    ) -> None:
        self.pipe: ServicePipe | None = None  #: joins both, once the server is reached
        self._context = context
        self._owner = owner
        self._client = client
        self._fields = fields
        self._link: DialledLink | None = None

    def dial(self) -> None:
        """Opens the link. Reading from the client pauses until the server has answered."""
        md5sum, client = self._fields.get("md5sum", ANY), tuple(sorted(self._fields.items()))
        hello = dataclasses.replace(
            self._owner.hello(), subject=Subject.CALL, md5sum=md5sum, client=client
        )
        try:
            header_bytes(hello.fields())
        except HeaderError as error:
            self.fail(str(error))
            return
        self._client.hold()
        address = self._owner.wanted.address

        def found(host: str) -> None:
            if not self._client.is_closed:
                self._link = DialledLink(self._context, self, address, hello)
                self._link.connect(host, address.port)

        self._context.resolver.resolve(
            address.host, found, lambda reason: self.link_lost(LinkState.UNREACHABLE, reason)
        )

    def link_up(self, fields: dict[str, str]) -> None:
        """Called when the server has answered the handshake."""
        assert self._link is not None
        self._owner.reached()
        self.pipe = ServicePipe(
            self._client, self._link, self._context.config.max_message_size, self._owner.totals
        )
        header = {key: fields[key] for key in PASSED_ON if key in fields}
        self._client.send(header_bytes({**header, "callerid": self._owner.wanted.proxy}))

    def link_lost(self, state: LinkState, reason: str) -> None:
        """Fails the call."""
        self._link = None
        if state is LinkState.NO_SERVER:
            self._owner.not_reached(reason)
        self.fail(reason)

    def fail(self, reason: str) -> None:
        """Reports an error to the client."""
        if self._client.is_closed:
            return
        if self.pipe is None:
            self._client.finish(header_bytes({"error": reason[:MAX_REASON]}))
        else:
            self._client.finish(self.pipe.conversation.error(reason))
        if self._link is not None:
            self._link.close("")

    def ended(self, reason: str) -> None:
        """Ends the call: its client has disconnected."""
        self._owner.calls.discard(self)
        if self._link is not None:
            self._link.close(reason)
