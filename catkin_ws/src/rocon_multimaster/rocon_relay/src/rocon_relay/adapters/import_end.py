"""The importing end of a topic's link: connects, registers the proxy, fetches messages while there are subscribers."""

import dataclasses
from collections.abc import Callable, Mapping

from rocon_relay.adapters.context import Context
from rocon_relay.adapters.dialled_link import TopicLink, hello_to
from rocon_relay.adapters.proxy_topic import ProxyTopic
from rocon_relay.adapters.registration import Nodes
from rocon_relay.adapters.sieve import Inflater
from rocon_relay.adapters.standing_import import StandingImport
from rocon_relay.core.connection import ANY, Import, LinkState, LinkStatus, Subject
from rocon_relay.core.link import limit_from_fields, mismatch, state_from_field
from tcpros.adapters.stream import Stream
from tcpros.core.fanout import Fanout
from tcpros.core.frame import control_frame
from tcpros.core.header import header_bytes


class ImportEnd(StandingImport):
    """One import, from the first connection attempt to the last unregistration.

    Messages are fetched while the proxy has a subscriber. A subscriber's handshake is answered once the publisher's
    connection header is known, so that the subscriber gets the real type, definition and latching.
    """

    def __init__(self, context: Context, nodes: Nodes, wanted: Import, ended: Callable[[], None]) -> None:
        super().__init__(context, wanted, ended)
        self.fanout = Fanout(context.config.max_message_size)
        self.registration = self.topic = ProxyTopic(context, nodes, self, wanted)
        self._source: dict[str, str] | None = None
        self._told_source: tuple[str, str] | None = None
        self._pending: dict[Stream, Mapping[str, str]] = {}
        self._demand = 0
        self._wants = False
        self._drops = 0
        self._inflater: Inflater | None = None
        self._saved = 0
        self._limit = ""

    def link(self) -> TopicLink:
        """Returns a new link to the source gateway."""
        wanted = self.wanted
        types = wanted.type, wanted.md5sum
        hello = hello_to(self._context, wanted.source_gateway, Subject.TOPIC, wanted.topic, wanted.source_node, *types)
        hello = dataclasses.replace(hello, options=wanted.options)
        return TopicLink(self._context, self, wanted.address, hello)

    def replace(self, wanted: Import) -> None:
        """Replaces the import by one with the same key but a different address, nodes or options."""
        moved = (wanted.address, wanted.type, wanted.md5sum, wanted.options) != (
            self.wanted.address,
            self.wanted.type,
            self.wanted.md5sum,
            self.wanted.options,
        )
        nodes_changed = wanted.allowed_nodes != self.wanted.allowed_nodes
        self.wanted = self.topic.wanted = wanted
        self.topic.close_disallowed()
        if nodes_changed:
            # On a repeated registration, the master notifies all subscribers, so those refused before try again.
            self.topic.refresh()
        if moved:
            self.redial("its address, type or options have changed")

    def status(self) -> LinkStatus:
        """Returns the status of the import."""
        drops = self._drops + sum(subscriber.backlog.drops for subscriber in self.topic.subscribers)
        counted = self.fanout.messages, self.fanout.bytes
        saved = self._saved + (self._inflater.saved if self._inflater else 0)
        return LinkStatus(self._state, self._reason, len(self.topic.subscribers), *counted, drops, saved=saved)

    def inlet(self, fields: dict[str, str]) -> Fanout:
        """Returns the fan-out for the frames of a link with this welcome."""
        self._limit = limit_from_fields(fields)
        if "compress" not in fields:
            return self.fanout
        self._inflater = Inflater(self.fanout, self._context.config.max_message_size)
        compressed = Fanout(self._context.config.max_message_size)
        compressed.join(self._inflater)
        return compressed

    def ping(self, last: float) -> bool:
        """Measures the round trip to the source gateway, reporting the last one [s]; returns False if no link is up."""
        if not isinstance(self._link, TopicLink) or not self._link.is_up:
            return False
        self._link.ping(last)
        return True

    def watch(self, late: bool) -> None:
        """Closes the link if it stays silent; see `dialled_link.TopicLink`."""
        if isinstance(self._link, TopicLink) and self._link.is_up:
            self._link.watch(late)

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
            self._source_failed(state_from_field(fields.get("state", "")), fields.get("reason", ""))
        elif fields.get("op") == "connected" and self._wants and fields.get("demand") == str(self._demand):
            self._source_found(fields)

    def _source_failed(self, state: LinkState, reason: str) -> None:
        self._set(state, reason)
        if state is LinkState.TYPE_MISMATCH:
            self.topic.hide()

    def _source_found(self, fields: dict[str, str]) -> None:
        wrong = mismatch(self.wanted.type, self.wanted.md5sum, fields.get("type", ANY), fields.get("md5sum", ANY))
        if wrong:
            self._source_failed(LinkState.TYPE_MISMATCH, wrong)
            return
        told = fields.get("type", ANY), fields.get("md5sum", ANY)
        if self._told_source not in (None, told) and self.topic.subscribers:
            self.topic.hide()  # the subscribers got another definition and have to reconnect
            self.topic.show()
            return
        self._source = fields
        self.fanout.begin(fields.get("latching") == "1")
        if self._state is LinkState.TYPE_MISMATCH:
            self.topic.show()
        elif self._state is LinkState.NO_PUBLISHER:
            self._set_active()
        pending, self._pending = self._pending, {}
        for subscriber, asked in pending.items():
            refusal = self._serve(subscriber, asked)
            if refusal:
                subscriber.finish(header_bytes({"error": refusal}))

    def subscribed(self, subscriber: Stream, fields: Mapping[str, str]) -> str:
        """Adds a subscriber; returns why it is refused, "" if it is accepted."""
        self._context.bound(subscriber.backlog, self.wanted.options)
        if self._source is not None:
            return self._serve(subscriber, fields)
        wrong = mismatch(fields.get("type", ANY), fields.get("md5sum", ANY), self.wanted.type, self.wanted.md5sum)
        if wrong:
            return wrong
        self._pending[subscriber] = fields
        self._want(True)
        return ""

    def unsubscribed(self, subscriber: Stream) -> None:
        """Removes a subscriber."""
        self._drops += subscriber.backlog.drops
        self._pending.pop(subscriber, None)
        self.fanout.remove(subscriber)
        if not self.topic.subscribers and self._state is not LinkState.TYPE_MISMATCH:
            self._want(False)

    def shown(self) -> None:
        """Called when the proxy is registered."""
        self._set_active()
        if not self.topic.subscribers:
            self._want(False)

    def _serve(self, subscriber: Stream, fields: Mapping[str, str]) -> str:
        source = self._source or {}
        type_, md5sum = source.get("type", ANY), source.get("md5sum", ANY)
        wrong = mismatch(fields.get("type", ANY), fields.get("md5sum", ANY), type_, md5sum)
        if wrong:
            return wrong
        header = {key: value for key, value in source.items() if key not in ("op", "demand")}
        self._told_source = type_, md5sum
        subscriber.send(header_bytes({**header, "topic": self.wanted.topic, "callerid": self.wanted.proxy}))
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
        self._set(LinkState.RATE_LIMITED if self._limit else LinkState.ACTIVE, self._limit)
