"""Copies parameters from one master to another, once. Each value is sent as XML-RPC text on its own link."""

import struct
import xmlrpc.client
from collections.abc import Callable
from typing import Any

from rocon_relay.connection import Address, Export, Import, LinkState, LinkStatus
from rocon_relay.context import Context
from rocon_relay.dialled_link import DialledLink
from rocon_relay.export_end import ExportEnd
from rocon_relay.link import Hello, LinkError
from rocon_relay.proxy_node import ProxyNodes
from rocon_relay.standing_import import DialledImport
from tcpros.http import NONSENSE, xmlrpc_values

MAX_PARAMETER = 2**20
"""Maximum size of a parameter's value as XML-RPC text [bytes]."""

_LENGTH = struct.Struct("<I")


class ParameterExportEnd:
    """One exported parameter, read from our master whenever a link requests it."""

    def __init__(self, context: Context, export: Export) -> None:
        self.export = export
        self._context = context
        self._times = 0
        self._bytes = 0

    def admit(self, link: ExportEnd, _hello: Hello) -> None:
        """Sends the value on a link and closes the link."""
        link.timer.cancel()

        def failed(reason: str) -> None:
            if not link.is_closed:
                link.refuse(LinkState.NO_PARAMETER, reason)

        def found(value: Any) -> None:
            if not link.is_closed:
                self._send(link, value)

        arguments = (self._context.config.node, self.export.topic)
        self._context.master.call("getParam", arguments, found, failed)

    def _send(self, link: ExportEnd, value: Any) -> None:
        try:
            text = xmlrpc.client.dumps((value,)).encode()
        except (TypeError, OverflowError) as error:
            link.refuse(LinkState.REFUSED, f"{self.export.topic} cannot be copied: {error}")
            return
        if len(text) > MAX_PARAMETER:
            reason = f"{self.export.topic} takes {len(text)} bytes, more than {MAX_PARAMETER}"
            link.refuse(LinkState.REFUSED, reason)
            return
        self._times += 1
        self._bytes += len(text)
        link.welcome({})
        link.finish(_LENGTH.pack(len(text)) + text)
        self._context.changed()

    def close(self, _reason: str = "") -> None:
        """Does nothing: there is no permanent link."""

    def status(self) -> LinkStatus:
        """Returns the status of the export."""
        if not self._times:
            return LinkStatus(LinkState.PENDING, "not read by the far gateway")
        return LinkStatus(LinkState.ACTIVE, "", 0, self._times, self._bytes)


class _ParameterLink(DialledLink):
    """A link that receives one value."""

    def __init__(
        self, context: Context, owner: "ParameterImportEnd", address: Address, hello: Hello
    ) -> None:
        super().__init__(context, owner, address, hello)
        self._import = owner
        self._received = bytearray()

    def accepted(self, fields: dict[str, str]) -> None:
        """Handles the welcome."""
        super().accepted(fields)
        self._timer = self._reactor.call_later(
            self._context.config.handshake_timeout, self._too_late
        )

    def _parse_more(self, data: memoryview) -> int:
        self._received += data
        if len(self._received) >= _LENGTH.size:
            size = _LENGTH.unpack_from(self._received)[0]
            if size > MAX_PARAMETER:
                raise LinkError(f"a parameter of {size} bytes is longer than {MAX_PARAMETER}")
            if len(self._received) >= _LENGTH.size + size:
                self._import.received(bytes(self._received[_LENGTH.size : _LENGTH.size + size]))
                self.close("")
        return len(data)


class ParameterImportEnd(DialledImport):
    """One parameter to copy. Requests it until it has arrived; copies it again only if our master has lost it."""

    link_class = _ParameterLink

    def __init__(
        self, context: Context, _nodes: ProxyNodes, wanted: Import, ended: Callable[[], None]
    ) -> None:
        super().__init__(context, wanted, ended)
        self._is_copied = False
        self._size = 0

    def replace(self, wanted: Import) -> None:
        """Replaces the import by one with the same key; the next attempt uses its address."""
        self.wanted = wanted

    def refresh(self) -> None:
        """Does nothing: a master that only hung keeps its parameters, which may have been changed there."""

    def restore(self) -> None:
        """Copies the parameter again, for a restarted master that has lost it."""
        if self._is_copied:
            self._is_copied = False
            self.start()

    def end(self) -> None:
        """Stops requesting the parameter; a copied value stays on the master."""
        super().end()
        if self._link is not None:
            self._link.close("")
        self._ended()

    def status(self) -> LinkStatus:
        """Returns the status of the import."""
        return LinkStatus(self._state, self._reason, 0, int(self._size > 0), self._size)

    def link_lost(self, state: LinkState, reason: str) -> None:
        """Schedules the next attempt unless the value has been copied."""
        self._link = None
        if not self._is_copied:
            self._retry(state, reason)

    def received(self, text: bytes) -> None:
        """Writes the received value to our master. Raises LinkError if it is not XML-RPC text."""
        try:
            (value,), _ = xmlrpc_values(text)
        except NONSENSE:
            raise LinkError("the parameter's value is no XML-RPC text") from None
        self._is_copied = True

        def copied(_value: Any) -> None:
            self._pause.reset()
            self._size = len(text)
            self._set(LinkState.ACTIVE, f"copied once, {len(text)} bytes")

        def failed(reason: str) -> None:
            self._is_copied = False
            self._retry(LinkState.PENDING, f"our master does not take it: {reason}")

        arguments = (self._context.config.node, self.wanted.topic, value)
        self._context.master.call("setParam", arguments, copied, failed)
