"""The importing end of a topic's link: connects, registers the proxy, fetches messages while there are subscribers."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from rocon_relay.connection import ANY, Import, LinkState, LinkStatus
from rocon_relay.context import Context
from rocon_relay.dialled_link import TopicLink
from rocon_relay.latch import latch_for
from rocon_relay.link import Hello, limit_from_fields, mismatch, state_from_field
from rocon_relay.outlet import Inflater
from rocon_relay.pattern import matches_whole
from rocon_relay.proxy_node import ProxyNode, ProxyNodes
from rocon_relay.standing_import import StandingImport
from tcpros.fanout import Fanout
from tcpros.frame import control_frame
from tcpros.header import header_bytes, printable
from tcpros.node_port import Ended, RefusedError
from tcpros.stream import Stream
from tcpros.topic_source import RELAYED_NODE

MAX_REPORTED = 64
"""Number of subscribers of another type that are remembered, so that each is logged once only."""


class ImportEnd(StandingImport):
    """One import and its proxy's topic, from the first connection attempt to the last unregistration.

    Messages are fetched while the proxy has a subscriber. A subscriber's handshake is answered once the publisher's
    connection header is known, so that the subscriber gets the real type, definition and latching.
    """

    link_class = TopicLink

    def __init__(
        self, context: Context, nodes: ProxyNodes, wanted: Import, ended: Callable[[], None]
    ) -> None:
        super().__init__(context, nodes, wanted, ended)
        self.fanout = Fanout(context.config.max_message_size)
        self.subscribers: dict[Stream, str] = {}  #: connected subscribers, name by connection
        self._source: dict[str, str] | None = None
        self._told_source: tuple[str, str] | None = None
        self._pending: dict[Stream, Mapping[str, str]] = {}
        self._demand = 0
        self._wants = False
        self._drops = 0
        self._inflater: Inflater | None = None
        self._saved = 0
        self._limit = ""
        self._reported_mismatches: dict[tuple[str, str], None] = {}

    @property
    def type(self) -> str:
        """The message type."""
        return self.wanted.type

    def hello(self) -> Hello:
        """Returns the hello of a link for this topic."""
        wanted = self.wanted
        return dataclasses.replace(
            super().hello(), type=wanted.type, md5sum=wanted.md5sum, options=wanted.options
        )

    def offered_by(self, node: ProxyNode) -> dict[str, Any]:
        """Returns the node's topics."""
        return node.topics

    def registering(self, node: ProxyNode) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method and arguments that register it."""
        return "registerPublisher", (self.wanted.topic, self.wanted.type, node.uri)

    def unregistering(self, node: ProxyNode) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method and arguments that unregister it."""
        return "unregisterPublisher", (self.wanted.topic, node.uri)

    def close_users(self) -> None:
        """Closes the connections of all subscribers."""
        for subscriber in tuple(self.subscribers):
            subscriber.close("")

    def replace(self, wanted: Import) -> None:
        """Replaces the import by one with the same key but a different address, nodes or options."""
        moved = (wanted.address, wanted.type, wanted.md5sum, wanted.options) != (
            self.wanted.address,
            self.wanted.type,
            self.wanted.md5sum,
            self.wanted.options,
        )
        nodes_changed = wanted.allowed_nodes != self.wanted.allowed_nodes
        self.wanted = wanted
        for subscriber, name in tuple(self.subscribers.items()):
            if self.registration.is_serving and self.refusal(name):
                subscriber.close("")
        if nodes_changed:
            # On a repeated registration, the master notifies all subscribers, so those refused before try again.
            self.registration.refresh()
        if moved:
            self.redial("its address, type or options have changed")

    def status(self) -> LinkStatus:
        """Returns the status of the import."""
        drops = self._drops + sum(subscriber.backlog.drops for subscriber in self.subscribers)
        counted = self.fanout.messages, self.fanout.bytes
        saved = self._saved + (self._inflater.saved if self._inflater else 0)
        return LinkStatus(
            self._state, self._reason, len(self.subscribers), *counted, drops, saved=saved
        )

    @property
    def running_link(self) -> TopicLink | None:
        """The link, if it is up."""
        return (
            self._link
            if isinstance(self._link, TopicLink) and self._link.fanout is not None
            else None
        )

    def link_up(self, fields: dict[str, str]) -> None:
        """Called with the welcome when the link is up."""
        assert self._link is not None
        self._limit = limit_from_fields(fields)
        self._link.fanout = self.fanout
        if "compress" in fields:
            self._inflater = Inflater(self.fanout, self._context.config.max_message_size)
            self._link.fanout = Fanout(self._context.config.max_message_size)
            self._link.fanout.join(self._inflater)
        super().link_up(fields)

    def link_lost(self, state: LinkState, reason: str) -> None:
        """Resets the source and schedules the next attempt."""
        self._source = None
        self._wants = False
        if self._inflater is not None:
            self._saved += self._inflater.saved
            self._inflater = None
        self.fanout.restart()
        super().link_lost(state, reason)

    def told(self, fields: dict[str, str]) -> None:
        """Handles a control frame from the source."""
        if fields.get("op") == "state":
            reason = printable(fields.get("reason", ""))
            self._source_failed(state_from_field(fields.get("state", "")), reason)
        elif (
            fields.get("op") == "connected"
            and self._wants
            and fields.get("demand") == str(self._demand)
        ):
            self._source_found(fields)

    def _source_failed(self, state: LinkState, reason: str) -> None:
        self._set(state, reason)
        if state is LinkState.TYPE_MISMATCH:
            self.registration.hide()

    def _source_found(self, fields: dict[str, str]) -> None:
        wrong = mismatch(
            self.wanted.type, self.wanted.md5sum, fields.get("type", ANY), fields.get("md5sum", ANY)
        )
        if wrong:
            self._source_failed(LinkState.TYPE_MISMATCH, wrong)
            return
        told = fields.get("type", ANY), fields.get("md5sum", ANY)
        if self._told_source not in (None, told) and self.subscribers:
            self.registration.hide()  # the subscribers got another definition and have to reconnect
            self.registration.show()
            return
        self._source = fields
        self.fanout.begin(fields.get("latching") == "1", latch_for(fields.get("type", ANY)))
        if self._state is LinkState.TYPE_MISMATCH:
            self.registration.show()
        elif self._state is LinkState.NO_PUBLISHER:
            self._set_active()
        pending, self._pending = self._pending, {}
        for subscriber, asked in pending.items():
            refusal = self._serve(subscriber, asked)
            if refusal:
                self._report_mismatch(printable(asked.get("callerid", "")), refusal)
                subscriber.finish(header_bytes({"error": refusal}))

    def refusal(self, name: str) -> str:
        """Returns why a node of that name may not subscribe, "" if it may."""
        if not self.registration.is_serving:
            return f"{self.wanted.topic} is not relayed any more"
        allowed = self.wanted.allowed_nodes
        if allowed and not any(matches_whole(pattern, name) for pattern in allowed):
            whom = " and ".join(allowed)
            return f"{self.wanted.topic} of {self.wanted.source_gateway} is relayed for {whom} only, not for {name}"
        return ""

    def admit(self, subscriber: Stream, fields: Mapping[str, str]) -> Ended:
        """Accepts a subscriber with its connection header. Raises RefusedError."""
        name = printable(fields.get("callerid", ""))
        if refusal := self.refusal(name):
            raise RefusedError(refusal)
        if refusal := self._subscribe(subscriber, fields):
            self._report_mismatch(name, refusal)
            raise RefusedError(refusal)
        self.subscribers[subscriber] = name
        return lambda _reason: self._unsubscribe(subscriber)

    def _subscribe(self, subscriber: Stream, fields: Mapping[str, str]) -> str:
        """Adds a subscriber; returns why it is refused, "" if it is accepted."""
        self._context.bound(subscriber.backlog, self.wanted.options)
        if self._source is not None:
            return self._serve(subscriber, fields)
        # The type that the far master lists may be out of date; the publisher's header decides.
        self._pending[subscriber] = fields
        self._want(True)
        return ""

    def _report_mismatch(self, subscriber: str, difference: str) -> None:
        """Logs, once per subscriber and difference, that its type is not the publisher's."""
        key = subscriber, difference
        if key in self._reported_mismatches:
            return
        self._reported_mismatches[key] = None
        if len(self._reported_mismatches) > MAX_REPORTED:
            del self._reported_mismatches[next(iter(self._reported_mismatches))]
        self._context.logger.warning(
            "type mismatch: %s gets no %s of %s: %s",
            subscriber,
            self.wanted.topic,
            self.wanted.proxy,
            difference,
        )

    def _unsubscribe(self, subscriber: Stream) -> None:
        del self.subscribers[subscriber]
        self._drops += subscriber.backlog.drops
        self._pending.pop(subscriber, None)
        self.fanout.remove(subscriber)
        if not self.subscribers and self._state is not LinkState.TYPE_MISMATCH:
            self._want(False)

    def shown(self) -> None:
        """Called when the proxy is registered."""
        self._set_active()
        if not self.subscribers:
            self._want(False)

    def _serve(self, subscriber: Stream, fields: Mapping[str, str]) -> str:
        source = self._source or {}
        type_, md5sum = source.get("type", ANY), source.get("md5sum", ANY)
        wrong = mismatch(fields.get("type", ANY), fields.get("md5sum", ANY), type_, md5sum)
        if wrong:
            return wrong
        header = {key: value for key, value in source.items() if key not in ("op", "demand")}
        self._told_source = type_, md5sum
        own = {
            "topic": self.wanted.topic,
            "callerid": self.wanted.proxy,
            RELAYED_NODE: self.wanted.source_node,
        }
        subscriber.send(header_bytes({**header, **own}))
        if not subscriber.is_closed:
            self.fanout.join(subscriber)
        return ""

    def _want(self, wants: bool) -> None:
        if wants == self._wants or self._link is None:
            return
        self._wants = wants
        self._source = self._told_source = None
        self._demand += wants
        op = "subscribe" if wants else "unsubscribe"
        self._link.send(control_frame(op=op, demand=str(self._demand)))

    def _set_active(self) -> None:
        reason = "; ".join(filter(None, (self._limit, self.path_advice)))
        state = self.working_state
        if self._limit and state is LinkState.ACTIVE:
            state = LinkState.RATE_LIMITED
        self._set(state, reason)
