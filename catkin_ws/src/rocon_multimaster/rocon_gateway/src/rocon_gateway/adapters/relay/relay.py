"""The real data plane: sockets, one thread, and what the control plane asks of it."""

import logging
import re
import socket
import threading
from collections.abc import Hashable, Iterable

from rocon_gateway.adapters.relay.context import Context
from rocon_gateway.adapters.relay.export_end import ExportEnd
from rocon_gateway.adapters.relay.import_end import ImportEnd
from rocon_gateway.adapters.relay.proxy_node import ProxyNodes
from rocon_gateway.adapters.relay.reactor import Reactor
from rocon_gateway.adapters.relay.stream import Listener
from rocon_gateway.adapters.relay.subscription import Subscription
from rocon_gateway.core.connection import (
    ConnectionConflictError,
    Export,
    Import,
    Key,
    LinkState,
    LinkStatus,
    OnChange,
    RelayConfig,
    RelayStatus,
)
from rocon_gateway.core.link import Hello, mismatch

MAX_STRANGERS = 256
"""Connections to the relay's port that have not been accepted as links yet; one more closes the oldest."""

SHUTDOWN_TIME = 1.5
"""How long the end waits for unregistrations [s]."""


class TcpRelay:
    """Implements `core.connection.Relay`; runs from its making to `shutdown`.

    Raises:
        OSError: the port cannot be had.
    """

    def __init__(self, config: RelayConfig, on_change: OnChange, logger: logging.Logger) -> None:
        self._reactor = Reactor(logger)
        self._context = Context(config, self._reactor, logger, self._changed)
        self._on_change = on_change
        self._nodes = ProxyNodes(self._context)
        self._exports: dict[Key, Export] = {}
        self._imports: dict[Key, ImportEnd] = {}
        self._retiring: dict[Key, ImportEnd] = {}
        self._links: dict[Key, ExportEnd] = {}
        self._strangers: dict[ExportEnd, None] = {}
        self._parked: dict[ExportEnd, Hello] = {}
        self._subscriptions: dict[tuple[str, str], Subscription] = {}
        self._change_is_told = False
        self._is_down = threading.Event()
        self._stopping = False
        self._listener = Listener(self._reactor, config.bind, config.port, self._accepted)
        self._listener.start()
        self._reactor.start()

    @property
    def port(self) -> int:
        """The TCP port where links arrive."""
        return self._listener.port

    def apply(self, exports: set[Export], imports: set[Import]) -> None:
        """See `core.connection.Relay`."""
        _check_unique((export.key for export in exports), "exports")
        _check_unique((import_.key for import_ in imports), "imports")
        _check_unique(((import_.topic, import_.proxy) for import_ in imports), "imports")
        for import_ in imports:
            re.compile(import_.allowed_nodes)
        wanted_exports = {export.key: export for export in exports}
        wanted_imports = {import_.key: import_ for import_ in imports}
        self._reactor.call(lambda: self._apply(wanted_exports, wanted_imports))

    def refresh(self) -> None:
        """See `core.connection.Relay`."""
        self._reactor.call(lambda: [end.topic.refresh() for end in self._imports.values()] and None)

    def status(self) -> RelayStatus:
        """See `core.connection.Relay`."""
        result: list[RelayStatus] = []
        done = threading.Event()

        def look() -> None:
            result.append(self._status())
            done.set()

        self._reactor.call(look)
        done.wait(1.0)
        return result[0] if result else RelayStatus()

    def shutdown(self) -> None:
        """See `core.connection.Relay`."""
        self._reactor.call(self._shut_down)
        self._is_down.wait(SHUTDOWN_TIME + 0.5)
        self._reactor.join(0.5)

    def _apply(self, exports: dict[Key, Export], imports: dict[Key, Import]) -> None:
        if self._stopping:
            return
        self._exports = exports
        for key, link in tuple(self._links.items()):
            if link.export != exports.get(key):
                link.close("")
        for end, hello in tuple(self._parked.items()):
            self._admit_if_exported(end, hello)
        for key in self._imports.keys() - imports.keys():
            self._retire(key)
        for key, import_ in imports.items():
            self._want(key, import_)

    def _want(self, key: Key, wanted: Import) -> None:
        end = self._imports.get(key)
        if end is not None:
            if end.wanted != wanted:
                end.replace(wanted)
            return
        self._imports[key] = end = ImportEnd(self._context, self._nodes, wanted, lambda: self._retired(key))
        if key not in self._retiring:
            end.start()

    def _retire(self, key: Key) -> None:
        end = self._imports.pop(key)
        if key not in self._retiring:  # otherwise it was waiting for its forerunner and has nothing to undo
            self._retiring[key] = end
            end.end()

    def _retired(self, key: Key) -> None:
        self._retiring.pop(key, None)
        if key in self._imports:
            self._imports[key].start()
        # An import that is not shown retires at once, while those after it still wait to be retired.
        if self._stopping and not self._imports and not self._retiring:
            self._stop()

    def _accepted(self, sock: socket.socket, peer: str) -> None:
        self._strangers[ExportEnd(self._context, self, sock, peer)] = None
        if len(self._strangers) > MAX_STRANGERS:
            next(iter(self._strangers)).close("malformed: too many connections wait to be accepted")

    def admit(self, end: ExportEnd, hello: Hello) -> None:
        """See `export_end.Exporter`."""
        if not self._admit_if_exported(end, hello):
            end.timer.cancel()
            self._parked[end] = hello
            what = f"publisher {hello.source_node} of {hello.topic}"
            reason = f"{hello.source_gateway} exports no {what} to {hello.sink_gateway}"
            end.timer = self._reactor.call_later(self._context.config.patience, lambda: self._give_up(end, reason))

    def _give_up(self, end: ExportEnd, reason: str) -> None:
        self._parked.pop(end, None)
        end.refuse(LinkState.REFUSED, reason)

    def _admit_if_exported(self, end: ExportEnd, hello: Hello) -> bool:
        key = Key(hello.topic, hello.sink_gateway, hello.source_node)
        export = self._exports.get(key)
        if export is None or end.is_closed:
            return False
        self._strangers.pop(end, None)
        self._parked.pop(end, None)
        wrong = mismatch(hello.type, "*", export.type, "*")
        if wrong:
            end.refuse(LinkState.TYPE_MISMATCH, wrong)
            return True
        former = self._links.pop(key, None)
        self._links[key] = end
        if former is not None:
            former.close("its peer dialled anew")
        end.accept(export)
        return True

    def subscription(self, topic: str, node: str) -> Subscription:
        """See `export_end.Exporter`."""
        key = topic, node
        if key not in self._subscriptions:
            self._subscriptions[key] = Subscription(
                self._context, topic, node, lambda: self._subscriptions.pop(key, None) and None
            )
        return self._subscriptions[key]

    def ended(self, end: ExportEnd) -> None:
        """See `export_end.Exporter`."""
        self._strangers.pop(end, None)
        self._parked.pop(end, None)
        if end.export is not None and self._links.get(end.export.key) is end:
            del self._links[end.export.key]

    def _status(self) -> RelayStatus:
        not_fetched = LinkStatus(LinkState.PENDING, "not dialled by the far gateway")
        exports = {
            export: self._links[key].status() if key in self._links else not_fetched
            for key, export in self._exports.items()
        }
        return RelayStatus(exports, {end.wanted: end.status() for end in self._imports.values()})

    def _changed(self) -> None:
        if not self._change_is_told:
            self._change_is_told = True
            self._reactor.call(self._tell_change)

    def _tell_change(self) -> None:
        self._change_is_told = False
        self._on_change()

    def _shut_down(self) -> None:
        if self._stopping:
            return
        self._stopping = True
        self._listener.close("")
        for link in (*self._links.values(), *self._strangers):
            link.close("")
        self._reactor.call_later(SHUTDOWN_TIME, self._stop)
        for key in tuple(self._imports):
            self._retire(key)
        if not self._retiring:
            self._stop()

    def _stop(self) -> None:
        self._is_down.set()
        self._reactor.stop()


def _check_unique(keys: Iterable[Hashable], what: str) -> None:
    seen: set[Hashable] = set()
    for key in keys:
        if key in seen:
            raise ConnectionConflictError(f"two {what} are the same connection: {key}")
        seen.add(key)
