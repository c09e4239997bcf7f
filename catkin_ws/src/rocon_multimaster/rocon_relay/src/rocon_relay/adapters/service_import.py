"""The importing end of a service: registers the proxy while the link is up; each client gets its own link."""

from collections.abc import Callable

from rocon_relay.adapters.context import Context
from rocon_relay.adapters.dialled_link import DialledLink, LinkOwner, hello_to
from rocon_relay.adapters.proxy_service import ProxyService
from rocon_relay.adapters.registration import Nodes
from rocon_relay.adapters.service_pipe import ServicePipe
from rocon_relay.adapters.standing_import import StandingImport
from rocon_relay.core.connection import ANY, Address, Import, LinkState, LinkStatus, Subject
from rocon_relay.core.link import Hello
from tcpros.adapters.stream import Stream
from tcpros.core.header import HeaderError, header_bytes

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

    def __init__(self, context: Context, nodes: Nodes, wanted: Import, ended: Callable[[], None]) -> None:
        super().__init__(context, wanted, ended)
        self.registration = self.service = ProxyService(context, nodes, self, wanted)
        self._calls = 0
        self._bytes = 0

    def hello(self, subject: Subject, md5sum: str = ANY) -> Hello:
        """Returns the hello of a link for this service."""
        wanted = self.wanted
        return hello_to(self._context, wanted.source_gateway, subject, wanted.topic, wanted.source_node, md5sum=md5sum)

    def link(self) -> DialledLink:
        """Returns a new link to the source gateway."""
        return DialledLink(self._context, self, self.wanted.address, self.hello(Subject.SERVICE))

    def replace(self, wanted: Import) -> None:
        """Replaces the import by one with the same key and a new address; calls in progress continue if they can."""
        self.wanted = self.service.wanted = wanted
        self.redial("its address has changed")

    def status(self) -> LinkStatus:
        """Returns the status of the import."""
        pipes = [call.pipe.conversation for call in self._running if call.pipe]
        calls = self._calls + sum(one.calls for one in pipes)
        size = self._bytes + sum(one.bytes for one in pipes)
        return LinkStatus(self._state, self._reason, len(self.service.calls), calls, size)

    @property
    def _running(self) -> "list[ImportedCall]":
        return [call for call in self.service.calls if isinstance(call, ImportedCall)]

    def called(self, client: Stream, fields: dict[str, str]) -> "ImportedCall":
        """Starts relaying a new client."""
        call = ImportedCall(self._context, self, client, fields)
        if not self.service.is_serving:
            call.fail(f"{self.wanted.topic} is not relayed any more")
        elif len(self.service.calls) >= MAX_CALLS:
            call.fail(f"{self.wanted.topic} has {MAX_CALLS} clients at a time and takes no more")
        else:
            call.dial()
        return call

    def reached(self) -> None:
        """Called when a call has reached the server."""
        if self._state is LinkState.NO_SERVER:
            self._set(LinkState.ACTIVE, "")

    def not_reached(self, reason: str) -> None:
        """Called when a call could not reach the server."""
        if self._state is LinkState.ACTIVE:
            self._set(LinkState.NO_SERVER, reason)

    def finished(self, call: "ImportedCall") -> None:
        """Called when a client has disconnected."""
        self.service.calls.discard(call)
        if call.pipe is not None:
            self._calls += call.pipe.conversation.calls
            self._bytes += call.pipe.conversation.bytes


class ImportedCall(LinkOwner):
    """One client's connection and the link for its calls."""

    def __init__(self, context: Context, owner: ServiceImportEnd, client: Stream, fields: dict[str, str]) -> None:
        self.pipe: ServicePipe | None = None  #: joins both, once the server is reached
        self._context = context
        self._owner = owner
        self._client = client
        self._fields = fields
        self._link: CallLink | None = None

    def dial(self) -> None:
        """Opens the link. Reading from the client pauses until the server has answered."""
        hello = self._owner.hello(Subject.CALL, self._fields.get("md5sum", ANY)).of_client(self._fields)
        try:
            header_bytes(hello.fields())
        except HeaderError as error:
            self.fail(str(error))
            return
        self._client.hold()
        address = self._owner.wanted.address

        def found(host: str) -> None:
            if not self._client.is_closed:
                self._link = CallLink(self._context, self, address, hello)
                self._link.connect(host, address.port)

        self._context.resolver.resolve(
            address.host, found, lambda reason: self.link_lost(LinkState.UNREACHABLE, reason)
        )

    def answered(self, link: "CallLink", fields: dict[str, str]) -> None:
        """Called when the server has answered the handshake."""
        self._owner.reached()
        self.pipe = ServicePipe(self._client, link, self._context.config.max_message_size)
        header = {key: fields[key] for key in PASSED_ON if key in fields}
        self._client.send(header_bytes({**header, "callerid": self._owner.wanted.proxy}))

    def link_up(self) -> None:
        """Does nothing: `answered` follows."""

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
        self._owner.finished(self)
        if self._link is not None:
            self._link.close(reason)


class CallLink(DialledLink):
    """The link for the calls of one client."""

    def __init__(self, context: Context, call: ImportedCall, address: Address, hello: Hello) -> None:
        super().__init__(context, call, address, hello)
        self._call = call

    def accepted(self, fields: dict[str, str]) -> None:
        """Handles the welcome."""
        self._call.answered(self, fields)
