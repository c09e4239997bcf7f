"""The exporting end of services: permanent links, and calls forwarded to the server."""

from collections.abc import Mapping
from typing import Any

from rocon_relay.connection import Export, LinkState, LinkStatus, Subject, proxy_name
from rocon_relay.context import Context
from rocon_relay.export_end import ExportEnd
from rocon_relay.link import Hello
from rocon_relay.service_import import MAX_REASON, PASSED_ON
from rocon_relay.service_pipe import ServicePipe
from tcpros.dialled_stream import DialledStream, watch_liveness
from tcpros.header import HeaderError, header_bytes, header_parser, printable
from tcpros.service_call import CallTotals
from tcpros.xmlrpc_client import host_and_port


class ServiceExportEnd:
    """One exported service: its permanent link and the calls in progress.

    Args:
        context: shared by all parts of the relay.
        export: the export.
    """

    def __init__(self, context: Context, export: Export) -> None:
        self.export = export
        #: cached host and port of the server from the last call; None if it has to be looked up
        self.server: tuple[str, int] | None = None
        self._context = context
        #: the permanent link, up as long as the far gateway offers the service; None for none
        self.standing: ExportEnd | None = None
        self.calls: set[ExportedCall] = set()  #: the calls in progress
        self.totals = CallTotals()  #: counts of all calls

    def admit(self, link: ExportEnd, hello: Hello) -> None:
        """Accepts a link: one for a single client, or the permanent one."""
        if hello.subject is Subject.CALL:
            call = ExportedCall(self._context, self, link, hello)
            self.calls.add(call)
            link.serve(call.ended)
            call.start()
            return
        former, self.standing = self.standing, link
        if former is not None:
            former.close("its peer has opened another one")
        link.serve(lambda _reason: self._stood(link))
        link.welcome({})
        self._context.changed()

    def _stood(self, link: ExportEnd) -> None:
        if self.standing is link:
            self.standing = None
            self._context.changed()

    def close(self, _reason: str = "") -> None:
        """Closes all its links."""
        if self.standing is not None:
            self.standing.close("")
        for call in tuple(self.calls):
            call.link.close("")

    def status(self) -> LinkStatus:
        """Returns the status of the export."""
        counts = len(self.calls), self.totals.calls, self.totals.bytes
        if self.standing is None:
            return LinkStatus(LinkState.PENDING, "not dialled by the far gateway", *counts)
        return LinkStatus(LinkState.ACTIVE, "", *counts)


class ExportedCall:
    """One client of another gateway: finds the server, connects, forwards the client's header and pipes both ways."""

    def __init__(
        self, context: Context, owner: ServiceExportEnd, link: ExportEnd, hello: Hello
    ) -> None:
        self.pipe: ServicePipe | None = (
            None  #: joins link and server, once the server has answered the handshake
        )
        self._context = context
        self._owner = owner
        self.link = link  #: the link from the far gateway
        self._hello = hello
        self._server: _Server | None = None
        self._remembered = False
        self._is_over = False
        self._timer = context.reactor.call_later(context.config.call_timeout, self._too_late)

    def start(self) -> None:
        """Connects to the server's cached address, which saves a call to the master, or looks it up."""
        self.link.hold()
        if self._owner.server is None:
            self._look_up()
        else:
            self._remembered = True
            self._dial(*self._owner.server)

    def _look_up(self) -> None:
        self._remembered = False
        arguments = (self._context.config.node, self._hello.topic)
        self._context.master.call("lookupService", arguments, self._located, self._failed)

    def _located(self, uri: Any) -> None:
        host, port = host_and_port(str(uri))
        if not host or not port:
            self._failed(f"{uri!r} is not the address of a server")
            return
        self._dial(host, port)

    def _dial(self, host: str, port: int) -> None:
        def found(address: str) -> None:
            if self._is_over:
                return
            try:
                header = header_bytes(self._header())
            except HeaderError as error:
                self._refuse(LinkState.REFUSED, str(error))
                return
            self._server = _Server(self._context, self, self._hello.source_node, header)
            self._server.connect(address, port)
            self._owner.server = host, port

        self._context.resolver.resolve(host, found, self._failed)

    def _header(self) -> Mapping[str, str]:
        """Returns the client's connection header with the caller name that its proxy would have here."""
        said = dict(self._hello.client)
        name = proxy_name(self._hello.sink_gateway, said.get("callerid", "") or "unnamed")
        return {**said, "service": self._hello.topic, "callerid": name}

    def found(self, header: Mapping[str, str]) -> None:
        """Called when the server has answered the handshake."""
        assert self._server is not None
        if "error" in header and self._remembered:
            self._server.close(
                printable(header["error"])
            )  # another node may use the cached address by now
            return
        self._timer.cancel()
        if "error" in header:
            self._refuse(LinkState.REFUSED, printable(header["error"]))
            return
        self.pipe = ServicePipe(
            self.link, self._server, self._context.config.max_message_size, self._owner.totals
        )
        self.link.welcome({key: header[key] for key in PASSED_ON if key in header})

    def lost(self, reason: str) -> None:
        """Called when the server has closed the connection or could not be reached."""
        self._server = None
        if self._is_over:
            return
        if self._remembered and self.pipe is None:
            self._look_up()
        elif self.pipe is None:
            self._failed(f"{self._hello.source_node}: {reason or 'it closed the connection'}")
        else:
            why = reason or "it closed the connection"
            self.link.finish(self.pipe.conversation.error(f"{self._hello.source_node}: {why}"))

    def ended(self, _reason: str) -> None:
        """Ends the call after its link was closed."""
        self._end()
        self._owner.calls.discard(self)

    def _too_late(self) -> None:
        self._failed(f"{self._hello.source_node} did not answer in time")

    def _failed(self, reason: str) -> None:
        self._owner.server = None
        self._refuse(LinkState.NO_SERVER, reason)

    def _refuse(self, state: LinkState, reason: str) -> None:
        if not self._is_over:
            self._end()
            self.link.refuse(state, reason[:MAX_REASON])

    def _end(self) -> None:
        self._is_over = True
        self._timer.cancel()
        if self._server is not None:
            self._server.close("")


class _Server(DialledStream):
    """The connection to the server."""

    def __init__(self, context: Context, call: ExportedCall, node: str, header: bytes) -> None:
        super().__init__(context.reactor, node, header)
        watch_liveness(self._socket)
        self._context = context
        self._call = call
        self.parse = header_parser(call.found)

    def closed(self, reason: str) -> None:
        if reason.startswith("malformed"):
            self._context.logger.warning("server %s: %s", self.peer, reason)
        self._call.lost(reason)
