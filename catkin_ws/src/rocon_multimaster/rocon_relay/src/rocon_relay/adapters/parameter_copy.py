"""Parameters from one master to another, once: the value crosses as XML-RPC text on a link of its own."""

import struct
import xmlrpc.client
from collections.abc import Callable
from typing import Any
from xml.parsers.expat import ExpatError

from rocon_relay.adapters.context import Context, Pause
from rocon_relay.adapters.dialled_link import DialledLink, LinkOwner, hello_to
from rocon_relay.adapters.export_end import ExportEnd
from rocon_relay.core.connection import Address, LinkState, LinkStatus
from rocon_relay.core.link import Hello, LinkError, Subject
from rocon_relay.core.service import MAX_PARAMETER, ParameterExport, ParameterImport
from tcpros.adapters.reactor import Timer

_LENGTH = struct.Struct("<I")


class ParameterExportEnd:
    """One exported parameter: read from our master whenever a link asks for it."""

    def __init__(self, context: Context, export: ParameterExport) -> None:
        self.export = export
        self._context = context
        self._times = 0
        self._bytes = 0

    def admit(self, link: ExportEnd, _hello: Hello) -> None:
        """Answers a link with the value, and closes it."""
        link.timer.cancel()

        def failed(reason: str) -> None:
            if not link.is_closed:
                link.refuse(LinkState.NO_PARAMETER, reason)

        def found(value: Any) -> None:
            if not link.is_closed:
                self._send(link, value)

        arguments = (self._context.config.node, self.export.name)
        self._context.master.call("getParam", arguments, found, failed)

    def _send(self, link: ExportEnd, value: Any) -> None:
        try:
            text = xmlrpc.client.dumps((value,)).encode()
        except (TypeError, OverflowError) as error:
            link.refuse(LinkState.REFUSED, f"{self.export.name} cannot be copied: {error}")
            return
        if len(text) > MAX_PARAMETER:
            reason = f"{self.export.name} takes {len(text)} bytes, more than {MAX_PARAMETER}"
            link.refuse(LinkState.REFUSED, reason)
            return
        self._times += 1
        self._bytes += len(text)
        link.welcome({})
        link.finish(_LENGTH.pack(len(text)) + text)
        self._context.changed()

    def close(self, _reason: str = "") -> None:
        """Nothing stands."""

    def status(self) -> LinkStatus:
        """How it does."""
        if not self._times:
            return LinkStatus(LinkState.PENDING, "not read by the far gateway")
        return LinkStatus(LinkState.ACTIVE, "", 0, self._times, self._bytes)


class ParameterImportEnd(LinkOwner):
    """One parameter to copy: asked for until it has come, then never again, unless our master forgets it."""

    def __init__(self, context: Context, wanted: ParameterImport, ended: Callable[[], None]) -> None:
        self.wanted = wanted
        self._context = context
        self._ended = ended
        self._link: _ParameterLink | None = None
        self._timer: Timer | None = None
        self._pause = Pause(context.config)
        self._is_ending = False
        self._is_copied = False
        self._status = LinkStatus(LinkState.PENDING, "dialling")

    def start(self) -> None:
        """Dials; repeated after each failure until the value has come, or `end`."""
        self._timer = None
        if not self._is_ending:
            self._context.resolver.resolve(
                self.wanted.address.host, self._dial, lambda reason: self.link_lost(LinkState.UNREACHABLE, reason)
            )

    def replace(self, wanted: ParameterImport) -> None:
        """Takes an import of the same key with another address; the next attempt goes there."""
        self.wanted = wanted

    def refresh(self) -> None:
        """Copies once more, for a master that has forgotten it."""
        if self._is_copied:
            self._is_copied = False
            self.start()

    def end(self) -> None:
        """Asks no longer; what was copied stays."""
        self._is_ending = True
        if self._timer is not None:
            self._timer.cancel()
        if self._link is not None:
            self._link.close("")
        self._ended()

    def status(self) -> LinkStatus:
        """How it does."""
        return self._status

    def _dial(self, host: str) -> None:
        if not self._is_ending:
            hello = hello_to(self._context, self.wanted.source_gateway, Subject.PARAMETER, self.wanted.name, "")
            self._link = _ParameterLink(self._context, self, self.wanted.address, hello)
            self._link.connect(host, self.wanted.address.port)

    def link_up(self) -> None:
        """Does nothing: `received` follows."""

    def link_lost(self, state: LinkState, reason: str) -> None:
        """Schedules the next attempt unless the value has been copied."""
        self._link = None
        if not self._is_ending and not self._is_copied:
            self._failed(state, reason)

    def received(self, text: bytes) -> None:
        """The value has come; raises LinkError if it is none."""
        try:
            (value,), _ = xmlrpc.client.loads(text)  # type: ignore[arg-type]
        except (xmlrpc.client.Error, ExpatError, ValueError, TypeError, LookupError, ArithmeticError, AttributeError):
            raise LinkError("the parameter's value is no XML-RPC text") from None
        self._is_copied = True
        name = self.wanted.name
        size = len(text)

        def failed(reason: str) -> None:
            self._is_copied = False
            self._failed(LinkState.PENDING, f"our master does not take it: {reason}")

        arguments = (self._context.config.node, name, value)
        self._context.master.call("setParam", arguments, lambda _value: self._copied(size), failed)

    def _copied(self, size: int) -> None:
        self._pause.reset()
        self._set(LinkStatus(LinkState.ACTIVE, f"copied once, {size} bytes", 0, 1, size))

    def _failed(self, state: LinkState, reason: str) -> None:
        self._set(LinkStatus(state, reason))
        if not self._is_ending:
            self._timer = self._context.reactor.call_later(self._pause.take(), self.start)

    def _set(self, status: LinkStatus) -> None:
        if status != self._status:
            self._status = status
            self._context.changed()


class _ParameterLink(DialledLink):
    """The link on which one value comes."""

    def __init__(self, context: Context, owner: ParameterImportEnd, address: Address, hello: Hello) -> None:
        super().__init__(context, owner, address, hello)
        self._import = owner
        self._received = bytearray()
        self._late: Timer | None = None

    def accepted(self, _fields: dict[str, str]) -> None:
        """Handles the welcome."""
        self.parse = self._parse_value
        self._late = self._context.reactor.call_later(self._context.config.handshake_timeout, self._too_late)

    def closed(self, reason: str) -> None:
        """Reports a link that closed before the whole value had arrived."""
        if self._late is not None:
            self._late.cancel()
        super().closed(reason)

    def _parse_value(self, data: memoryview) -> int:
        self._received += data
        if len(self._received) >= _LENGTH.size:
            size = _LENGTH.unpack_from(self._received)[0]
            if size > MAX_PARAMETER:
                raise LinkError(f"a parameter of {size} bytes is longer than {MAX_PARAMETER}")
            if len(self._received) >= _LENGTH.size + size:
                self._import.received(bytes(self._received[_LENGTH.size : _LENGTH.size + size]))
                self.close("")
        return len(data)
