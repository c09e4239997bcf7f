"""The exporting end of a link: handshake, authorization, forwarding."""

import secrets
import socket
from collections.abc import Mapping
from typing import Protocol

from rocon_relay.connection import ANY, Export, LinkState, LinkStatus
from rocon_relay.context import Context
from rocon_relay.link import (
    VERSION,
    AskError,
    Hello,
    LinkError,
    is_proof,
    mismatch,
    proof,
    seconds_from_field,
)
from rocon_relay.option import NO_OPTIONS
from rocon_relay.outlet import Sieve
from rocon_relay.subscription import Subscription
from tcpros.dialled_stream import watch_liveness
from tcpros.fanout import Outlet
from tcpros.frame import CONTROL_MARK, LENGTH_SIZE, Chunk, control_frame
from tcpros.header import header_bytes, header_parser, printable
from tcpros.node_port import Ended
from tcpros.reactor import Timer
from tcpros.stream import Stream
from tcpros.tls import VARIABLE
from tcpros.tls_socket import begins_tls

UNSENT = 64 * 1024
"""Limit of unsent data in the kernel for a link with a `queue_size` option [bytes]."""

NEEDS_TLS = (
    f"it speaks TLS only, and we have no certificate: set {VARIABLE} to a directory with one"
)
DIFFERS = "its password differs from ours"
NO_PASSWORD = "it asks for a password, and we have none"
NO_HUB = "it is on no hub of ours, or has not joined it yet"

_PASSED_ON = ("type", "md5sum", "message_definition", "latching", "topic")


class Exporter(Protocol):
    """What export ends need from the relay."""

    def admit(self, end: "ExportEnd", hello: Hello) -> None:
        """Calls `accept` or `refuse`, now or within the configured patience."""

    def subscription(self, export: Export) -> Subscription:
        """Returns the shared subscription to a publisher, new or existing."""

    def ended(self, end: "ExportEnd") -> None:
        """Called when the link has been closed."""


class ExportEnd(Stream):
    """One link opened by another gateway's relay."""

    def __init__(
        self, context: Context, exporter: Exporter, sock: socket.socket, peer: str
    ) -> None:
        super().__init__(
            context.reactor, sock, peer, context.tls.accepted(sock) if context.tls else None
        )
        watch_liveness(sock)
        self.hello: Hello | None = None  #: the peer's hello, once received
        self.export: Export | None = None  #: the export that serves it, once accepted
        self.outlet: Outlet = (
            self  #: receives the messages: the link itself, or the sieve in front of it
        )
        self._options = NO_OPTIONS
        self._sieve: Sieve | None = None
        self._left_out = self._saved = 0
        self._pong = b""
        self._context = context
        self._exporter = exporter
        self.is_proven = (
            self._tls is not None
        )  #: whether the peer has proved that it belongs to the fleet
        self._expected = self._proof = ""
        self._wanted = False
        self._demand = ""
        self._leaving = False
        self._subscription: Subscription | None = None
        self._ended: Ended | None = None
        self._messages = 0
        self._bytes = 0
        self._state = LinkState.ACTIVE
        self._reason = ""
        self.timer: Timer = context.reactor.call_later(
            context.config.handshake_timeout, self._too_late
        )
        self.parse = self._parse_first

    def status(self) -> LinkStatus:
        """Returns the status of the link."""
        drops = self.backlog.drops
        left_out, saved = self._left_out, self._saved
        if self._sieve is not None:
            left_out, saved = left_out + self._sieve.left_out, saved + self._sieve.saved
        went = self._messages - drops, self._bytes + saved
        return LinkStatus(
            self._state, self._reason, int(self._wanted), *went, drops, left_out, saved
        )

    def push(self, chunk: Chunk) -> None:
        """Counts and sends a chunk."""
        self._messages += chunk.ended
        self._bytes += len(chunk.data)
        super().push(chunk)
        if self._pong:
            self._answer_ping()

    def passed(self, count: int, ended: bool) -> None:
        """Counts bytes that were spliced."""
        self._messages += ended
        self._bytes += count
        super().passed(count, ended)
        if self._pong:
            self._answer_ping()

    def flush(self) -> None:
        """Sends queued data, and behind it the answer to a ping that met a filled queue."""
        super().flush()
        if self._pong:
            self._answer_ping()

    def accept(self, export: Export) -> None:
        """Accepts the link for this export."""
        self.timer.cancel()
        self.export = export
        self._options = export.options.joined(self.hello.options) if self.hello else export.options
        self._context.bound(self.backlog, self._options, drops_first=self._options.queue_size > 0)
        if self._options.queue_size:
            # Data already in the kernel cannot be dropped any more.
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT)
        self._set_active()
        self.parse = self._parse_control
        self.welcome(
            {
                key: value
                for key, value in self._options.fields().items()
                if key in ("rate", "compress")
            }
        )
        self._context.changed()

    def serve(self, ended: Ended) -> None:
        """Hands over a link that does not carry a topic; `ended` is called when it has been closed."""
        self.timer.cancel()
        self._ended = ended

    def welcome(self, fields: Mapping[str, str]) -> None:
        """Sends the welcome. It includes our proof of fleet membership if the sink has given its own.

        If the sink asks for a probe, the welcome fills a whole packet, and a small one goes ahead of it.
        """
        shown = {"proof": self._proof} if self._proof else {}
        own = self._context.config.gateway
        welcome = {"relay": VERSION, "source_gateway": own, **shown, **fields}
        if self.hello is not None and self.hello.probe:
            self.send(header_bytes({"relay": VERSION, "probe": str(self.hello.probe)}))
            missing = self.hello.probe - len(header_bytes(welcome))
            welcome["padding"] = "." * max(0, missing)
        self.send(header_bytes(welcome))

    def refuse(self, state: LinkState, reason: str) -> None:
        """Refuses the link and closes it."""
        self.timer.cancel()
        self.finish(header_bytes({"relay": VERSION, "error": printable(reason), "state": state}))

    def source_found(self, header: Mapping[str, str]) -> bool:
        """Compares the publisher's type with the requested one and starts forwarding."""
        assert self.hello is not None
        wrong = mismatch(
            self.hello.type, self.hello.md5sum, header.get("type", ANY), header.get("md5sum", ANY)
        )
        if wrong:
            self._tell(LinkState.TYPE_MISMATCH, wrong)
            return False
        if self._options.needs_messages:
            self._end_sieve()
            self.outlet = self._sieve = Sieve(
                self._reactor, self, self._options, header.get("type", ANY)
            )
        self._set_active()
        fields = {key: header[key] for key in _PASSED_ON if key in header}
        self.send(control_frame(op="connected", demand=self._demand, **fields))
        return (
            not self.is_closed
        )  # a link closed meanwhile has left the fan-out and must not rejoin

    def source_lost(self, reason: str) -> None:
        """Notifies the sink that there is no publisher."""
        self._tell(LinkState.NO_PUBLISHER, reason)

    def left(self) -> None:
        """Rejoins if the sink has subscribed again meanwhile; otherwise ends the subscription."""
        self._leaving = False
        if self._wanted:
            self._join()
        elif self._subscription is not None:
            subscription, self._subscription = self._subscription, None
            subscription.stop_if_unused()

    def without_tls(self) -> None:
        """Refuses a peer without TLS in plain text, so that it can log the reason."""
        self._refuse_client("it speaks no TLS, and this gateway speaks nothing else", NEEDS_TLS)

    def _refuse_client(self, what: str, reason: str) -> None:
        self._context.logger.warning("link from %s: %s", self.peer, what)
        self.refuse(LinkState.REFUSED, reason)

    def closed(self, reason: str) -> None:
        """Leaves the subscription and the relay."""
        self.timer.cancel()
        self._end_sieve()
        if reason.startswith(("malformed", "TLS")):
            self._context.logger.warning("link from %s: %s", self.peer, reason)
        if self._subscription is not None:
            self._subscription.remove(self)
        if self._ended is not None:
            self._ended(reason)
        self._exporter.ended(self)
        if self.export is not None:
            self._context.changed()

    def _join(self) -> None:
        assert self.export is not None
        self._subscription = self._exporter.subscription(self.export)
        self._subscription.join(self)

    def _tell(self, state: LinkState, reason: str) -> None:
        if (state, reason) != (self._state, self._reason):
            self.send(control_frame(op="state", state=state, reason=reason))
            self._set(state, reason)

    def _end_sieve(self) -> None:
        if self._sieve is not None:
            sieve, self._sieve = self._sieve, None
            sieve.end()
            self._left_out += sieve.left_out
            self._saved += sieve.saved

    def _set_active(self) -> None:
        limit = self._options.limit
        self._set(LinkState.RATE_LIMITED if limit else LinkState.ACTIVE, limit)

    def _set(self, state: LinkState, reason: str) -> None:
        if (state, reason) != (self._state, self._reason):
            self._state, self._reason = state, reason
            self._context.changed()

    def _too_late(self) -> None:
        # Not malformed: the connection may have been cut after it was accepted.
        timeout = self._context.config.handshake_timeout
        self._context.logger.warning(
            "link from %s: it did not introduce itself within %g s", self.peer, timeout
        )
        self.close("timed out: it did not introduce itself")

    def _parse_first(self, data: memoryview) -> int:
        if self._tls is None and begins_tls(data):
            self._refuse_client(
                f"it speaks TLS, and this gateway has no certificate ({VARIABLE})", "no TLS here"
            )
            return len(data)
        return header_parser(self._parse_hello)(data)

    def _parse_hello(self, fields: dict[str, str]) -> None:
        try:
            self.hello = Hello.from_fields(fields)
        except AskError as error:
            self.refuse(LinkState.REFUSED, str(error))
            return
        keyring = self._context.config.keyring
        if keyring is None:
            self._admit(self.hello)
            return
        found = keyring.key(self.hello.keys)
        if found is None:
            self.refuse(LinkState.REFUSED, NO_HUB if self.hello.keys else NO_PASSWORD)
            return
        challenge = secrets.token_hex(16)
        self._expected, self._proof = (
            proof(found[1], role, fields, challenge) for role in ("sink", "source")
        )
        self.parse = header_parser(self._parse_proof)
        self.send(header_bytes({"relay": VERSION, "challenge": challenge, "key": found[0]}))

    def _parse_proof(self, fields: dict[str, str]) -> None:
        assert self.hello is not None
        if is_proof(fields.get("proof", ""), self._expected):
            self.is_proven = True
            self._admit(self.hello)
        else:
            self._refuse_client(DIFFERS, DIFFERS)

    def _admit(self, hello: Hello) -> None:
        self.parse = header_parser(self._too_much)
        self._exporter.admit(self, hello)

    def _too_much(self, _fields: dict[str, str]) -> None:
        raise LinkError("it sent more before it was answered")

    def _parse_control(self, data: memoryview) -> int:
        if len(data) >= 4 and data[:4] != CONTROL_MARK:
            raise LinkError("it sent messages against the link's direction")
        return header_parser(self._control, LENGTH_SIZE)(data)

    def _answer_ping(self) -> None:
        # Queued behind waiting messages, the pong would force all of them out, although the queue may drop them.
        if not self.is_closed and self.backlog.is_empty and self.backlog.is_between:
            pong, self._pong = self._pong, b""
            self.send(pong)

    def _control(self, fields: dict[str, str]) -> None:
        if fields.get("op") == "ping":
            assert self.hello is not None
            self._context.round_trip(
                self.hello.sink_gateway, seconds_from_field(fields.get("last", ""))
            )
            self._pong = control_frame(op="pong", token=fields.get("token", ""))
            self._answer_ping()
            return
        wanted = fields.get("op") == "subscribe"
        if wanted == self._wanted:
            return
        self._demand = fields.get("demand", "")
        self._wanted = wanted
        if not wanted:
            self._leaving = True
            if self._subscription is not None:
                self._subscription.leave(self)
        elif not self._leaving:
            self._join()
