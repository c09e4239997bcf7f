"""The data plane: creates and removes the links that the control plane requests. Sockets run in one thread."""

import logging
import socket
import threading
import time
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping
from typing import TypeVar

from rocon_relay.connection import (
    ConnectionConflictError,
    Export,
    Import,
    Key,
    LinkState,
    LinkStatus,
    RelayConfig,
    RelayStatus,
    Subject,
)
from rocon_relay.context import Context
from rocon_relay.export_end import ExportEnd
from rocon_relay.import_end import ImportEnd
from rocon_relay.link import Hello, mismatch
from rocon_relay.parameter_copy import ParameterExportEnd, ParameterImportEnd
from rocon_relay.pattern import check_pattern
from rocon_relay.proxy_node import ProxyNodes
from rocon_relay.service_export import ServiceExportEnd
from rocon_relay.service_import import ServiceImportEnd
from rocon_relay.subscription import Subscription
from tcpros.listener import Listener
from tcpros.reactor import Reactor
from tcpros.tls import Certificates

MAX_UNIDENTIFIED = 256
"""Maximum number of connections not yet accepted as links; one more closes the oldest."""

_WHAT = {
    Subject.TOPIC: "publisher",
    Subject.SERVICE: "server",
    Subject.CALL: "server",
    Subject.PARAMETER: "parameter",
}
_ImportEnd = ImportEnd | ServiceImportEnd | ParameterImportEnd
_IMPORT_ENDS: dict[Subject, type[_ImportEnd]] = {
    Subject.TOPIC: ImportEnd,
    Subject.SERVICE: ServiceImportEnd,
    Subject.PARAMETER: ParameterImportEnd,
}
_EXPORT_ENDS: dict[Subject, type[ServiceExportEnd | ParameterExportEnd]] = {
    Subject.SERVICE: ServiceExportEnd,
    Subject.PARAMETER: ParameterExportEnd,
}
"""Topics are missing here: their links alone export them."""

Connected = TypeVar("Connected", Export, Import)

SHUTDOWN_TIME = 1.5
"""How long shutdown waits for unregistrations [s]."""


class TcpRelay:
    """The data plane; runs from its creation until `shutdown`.

    All methods may be called from any thread, but not from within `on_change`. Except for `shutdown`, they return
    without waiting for the network.

    Args:
        config: the configuration.
        on_change: called from the relay's thread whenever the state of a link has changed; must only set an event.
        logger: receives one line for each connection closed because of malformed data or a failed handshake.
        certificates: the fleet's certificates. If given, links are encrypted and peers without a certificate refused.
        reactor: the loop to run in. Its owner runs it, and creates the relay in the loop's thread or before the loop
            runs. Without one, the relay runs its own thread.

    Raises:
        OSError: the port is not available.
    """

    def __init__(
        self,
        config: RelayConfig,
        on_change: Callable[[], None],
        logger: logging.Logger,
        certificates: Certificates | None = None,
        reactor: Reactor | None = None,
    ) -> None:
        self._owned = reactor is None
        self._reactor = reactor or Reactor(logger)
        self._context = Context(config, self._reactor, logger, self._changed, certificates)
        self._on_change = on_change
        self._nodes = ProxyNodes(self._context)
        self._exports: Mapping[Key, Export] = {}
        self._others: dict[Key, ServiceExportEnd | ParameterExportEnd] = {}
        self._imports: dict[Key, _ImportEnd] = {}
        self._retiring: dict[Key, _ImportEnd] = {}
        self._links: dict[Key, ExportEnd] = {}
        self._unidentified: dict[ExportEnd, None] = {}
        self._peers: dict[str, set[ExportEnd]] = {}
        self._parked: dict[ExportEnd, Hello] = {}
        self._subscriptions: dict[tuple[str, str, str], Subscription] = {}
        self._change_is_told = False
        self._is_down = threading.Event()
        self._stopping = False
        self._listener = Listener(self._reactor, config.bind, config.port, self._accepted)
        self._listener.start()
        self._reactor.call(self._ping_later)
        self._reactor.call(self._watch_later)
        if self._owned:
            self._reactor.start()

    @property
    def port(self) -> int:
        """The TCP port for incoming links, known as soon as the relay exists."""
        return self._listener.port

    def apply(self, exports: Collection[Export], imports: Collection[Import]) -> None:
        """Sets the complete list of connections that shall exist.

        Connections in both the old and the new list keep running undisturbed. An import of which only the address
        changed keeps its subscribers only if the new relay answers. If `allowed_nodes` changed, subscribers that are
        no longer allowed are dropped. Connections no longer listed are unregistered, then closed, within a second.

        Raises:
            ConnectionConflictError: two exports or two imports have the same key. Nothing was changed.
            PatternError: one of `allowed_nodes` is not a regular expression. Nothing was changed.
        """
        wanted_exports = _by_name(exports, "exports")
        wanted_imports = _by_name(imports, "imports")
        topics = [one for one in imports if one.subject is Subject.TOPIC]
        _check_unique(((one.topic, one.proxy) for one in topics), "imports")
        _check_unique((one.topic for one in imports if one.subject is Subject.SERVICE), "imports")
        for pattern in {pattern for one in topics for pattern in one.allowed_nodes}:
            check_pattern(pattern)
        self._reactor.call(lambda: self._apply(wanted_exports, wanted_imports))

    def refresh(self) -> None:
        """Registers all proxies again, for a master that did not answer for a while."""
        self._reactor.call(lambda: [end.refresh() for end in self._imports.values()])

    def restore(self) -> None:
        """Registers all proxies and copies all parameters again, for a restarted master, which has lost them."""
        self._reactor.call(lambda: [end.restore() for end in self._imports.values()])

    def status(self) -> RelayStatus:
        """Returns a snapshot of the status of all connections from the last `apply`."""
        result: list[RelayStatus] = []
        done = threading.Event()

        def look() -> None:
            result.append(self._status())
            done.set()

        self._reactor.call(look)
        done.wait(1.0)
        return result[0] if result else RelayStatus()

    def shutdown(self) -> None:
        """Unregisters and closes everything and ends the thread; returns when this is done, within 2 s."""
        self._reactor.call(self._shut_down)
        self._is_down.wait(SHUTDOWN_TIME + 0.5)
        if self._owned:
            self._reactor.join(0.5)

    def _apply(self, exports: Mapping[Key, Export], imports: Mapping[Key, Import]) -> None:
        if self._stopping:
            return
        self._exports = exports
        # Before any link is closed: a closed link admits parked ones, for which the new ends must exist.
        removed = [self._others.pop(name) for name in self._others.keys() - exports.keys()]
        for name, export in exports.items():
            if name not in self._others and export.subject in _EXPORT_ENDS:
                self._others[name] = _EXPORT_ENDS[export.subject](self._context, export)
        for name, link in tuple(self._links.items()):
            if link.export != exports.get(name):
                link.close("")
        for end in removed:
            end.close()
        for waiting, hello in tuple(self._parked.items()):
            self._admit_if_exported(waiting, hello)
        for name in self._imports.keys() - imports.keys():
            self._retire(name)
        for name, import_ in imports.items():
            self._want(name, import_)

    def _want(self, name: Key, wanted: Import) -> None:
        end = self._imports.get(name)
        if end is not None and end.wanted.proxy != wanted.proxy:
            self._retire(name)
        elif end is not None:
            if end.wanted != wanted:
                end.replace(wanted)
            return
        kind = _IMPORT_ENDS[wanted.subject]
        self._imports[name] = end = kind(
            self._context, self._nodes, wanted, lambda: self._retired(name)
        )
        if name not in self._retiring:
            end.start()

    def _retire(self, name: Key) -> None:
        end = self._imports.pop(name)
        if name not in self._retiring:  # otherwise it never started, waiting for its predecessor
            self._retiring[name] = end
            end.end()

    def _retired(self, name: Key) -> None:
        self._retiring.pop(name, None)
        if name in self._imports:
            self._imports[name].start()
        # An unregistered import retires at once, while later ones still wait to be retired.
        if self._stopping and not self._imports and not self._retiring:
            self._stop()

    def _accepted(self, sock: socket.socket, peer: str) -> None:
        self._unidentified[ExportEnd(self._context, self, sock, peer)] = None
        if len(self._unidentified) > MAX_UNIDENTIFIED:
            next(iter(self._unidentified)).close(
                "malformed: too many connections wait to be accepted"
            )

    def admit(self, end: ExportEnd, hello: Hello) -> None:
        """Accepts or refuses a link, after the configured patience at the latest."""
        own = self._context.config.gateway
        if (
            end.is_proven and hello.source_gateway != own
        ):  # unproven peers get the answer for a missing export
            end.refuse(LinkState.REFUSED, f"this is {own}, not {hello.source_gateway}")
        elif not self._admit_if_exported(end, hello):
            end.timer.cancel()
            self._parked[end] = hello
            what = " of ".join(
                filter(None, (f"{_WHAT[hello.subject]} {hello.source_node}".strip(), hello.topic))
            )
            reason = f"{hello.source_gateway} exports no {what} to {hello.sink_gateway}"
            end.timer = self._reactor.call_later(
                self._context.config.patience, lambda: self._give_up(end, reason)
            )

    def _give_up(self, end: ExportEnd, reason: str) -> None:
        self._parked.pop(end, None)
        end.refuse(LinkState.REFUSED, reason)

    def _admit_if_exported(self, end: ExportEnd, hello: Hello) -> bool:
        subject = Subject.SERVICE if hello.subject is Subject.CALL else hello.subject
        name = Key(hello.topic, hello.sink_gateway, hello.source_node, subject)
        export, own = self._exports.get(name), self._context.config.gateway
        if export is None or hello.source_gateway != own or end.is_closed:
            return False
        if not end.is_proven and self._is_taken(name, hello):
            return False
        self._unidentified.pop(end, None)
        self._parked.pop(end, None)
        if own in hello.gateways_passed:
            end.refuse(LinkState.REFUSED, f"a loop: {' to '.join((own, *hello.gateways_passed))}")
            return True
        peers = self._peers.setdefault(hello.sink_gateway, set())
        if len(peers) >= self._context.config.max_links:
            end.refuse(
                LinkState.REFUSED,
                f"{hello.sink_gateway} has {len(peers)} links open here, and may have no more",
            )
            return True
        peers.add(end)
        if subject is Subject.TOPIC:
            self._admit_topic(name, end, hello, export)
        else:
            self._others[name].admit(end, hello)
        return True

    def _is_taken(self, name: Key, hello: Hello) -> bool:
        """Returns whether this link would replace an existing one, which only an authenticated gateway may do."""
        other = self._others.get(name)
        standing = (
            isinstance(other, ServiceExportEnd)
            and other.standing
            and hello.subject is not Subject.CALL
        )
        return name in self._links or bool(standing)

    def _admit_topic(self, name: Key, end: ExportEnd, hello: Hello, export: Export) -> None:
        wrong = mismatch(hello.type, "*", export.type, "*")
        if wrong:
            end.refuse(LinkState.TYPE_MISMATCH, wrong)
            return
        former = self._links.pop(name, None)
        self._links[name] = end
        if former is not None:
            former.close("its peer has opened another one")
        end.accept(export)

    def subscription(self, export: Export) -> Subscription:
        """Returns the shared subscription to a publisher, new or existing."""
        key = export.topic, export.source_node, export.subscriber
        if key not in self._subscriptions:
            self._subscriptions[key] = Subscription(
                self._context, export, lambda: self._subscriptions.pop(key, None)
            )
        return self._subscriptions[key]

    def ended(self, end: ExportEnd) -> None:
        """Removes a closed link."""
        self._unidentified.pop(end, None)
        self._parked.pop(end, None)
        peers = self._peers.get(end.hello.sink_gateway, set()) if end.hello else set()
        peers.discard(end)
        if end.hello and not peers:
            self._peers.pop(end.hello.sink_gateway, None)
        if end.export is not None and self._links.get(end.export.key) is end:
            del self._links[end.export.key]
        for waiting, hello in tuple(self._parked.items()):
            if end.hello and (hello.topic, hello.sink_gateway) == (
                end.hello.topic,
                end.hello.sink_gateway,
            ):
                self._admit_if_exported(waiting, hello)

    def _ping_later(self) -> None:
        self._reactor.call_later(self._context.config.ping_period, self._ping)

    def _ping(self) -> None:
        """Measures the round trip to each gateway on one link, and drops gateways without links."""
        trips, asked = self._context.round_trips, set[str]()
        for end in self._imports.values():
            if isinstance(end, ImportEnd) and end.wanted.source_gateway not in asked:
                gateway = end.wanted.source_gateway
                if link := end.running_link:
                    link.ping(trips[gateway].last if gateway in trips else 0.0)
                    asked.add(gateway)
        for gateway in trips.keys() - asked - self._peers.keys():
            del trips[gateway]
        self._ping_later()

    def _watch_later(self) -> None:
        period = self._context.config.silence / 5
        due = time.monotonic() + period
        # If this process was suspended, silence on the links proves nothing.
        self._reactor.call_later(period, lambda: self._watch(time.monotonic() > due + period))

    def _watch(self, late: bool) -> None:
        for end in tuple(self._imports.values()):
            if isinstance(end, ImportEnd) and (link := end.running_link):
                link.watch(late)
        self._watch_later()

    def _status(self) -> RelayStatus:
        exports = {export: self._export_status(name) for name, export in self._exports.items()}
        found = {gateway: trips.latency() for gateway, trips in self._context.round_trips.items()}
        latencies = {gateway: latency for gateway, latency in found.items() if latency}
        return RelayStatus(
            exports, {end.wanted: end.status() for end in self._imports.values()}, latencies
        )

    def _export_status(self, name: Key) -> LinkStatus:
        end = self._links.get(name) or self._others.get(name)
        return (
            end.status() if end else LinkStatus(LinkState.PENDING, "not dialled by the far gateway")
        )

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
        for link in (*self._links.values(), *self._others.values(), *self._unidentified):
            link.close("")
        self._reactor.call_later(SHUTDOWN_TIME, self._stop)
        for key in tuple(self._imports):
            self._retire(key)
        if not self._retiring:
            self._stop()

    def _stop(self) -> None:
        self._is_down.set()
        if self._owned:
            self._reactor.stop()


def _by_name(wanted: Collection[Connected], what: str) -> dict[Key, Connected]:
    _check_unique((one.key for one in wanted), what)
    return {one.key: one for one in wanted}


def _check_unique(keys: Iterable[Hashable], what: str) -> None:
    seen: set[Hashable] = set()
    for key in keys:
        if key in seen:
            raise ConnectionConflictError(f"two {what} are the same connection: {key}")
        seen.add(key)
