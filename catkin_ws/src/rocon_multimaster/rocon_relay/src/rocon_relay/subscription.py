"""The source side of a topic: a minimal TCPROS subscriber that forwards frames as they arrive."""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from rocon_relay.connection import ANY, Export
from rocon_relay.context import Context
from rocon_relay.latch import latch_for
from tcpros.fanout import Fanout, Outlet
from tcpros.reactor import Timer
from tcpros.topic_source import PublisherConnection, offered_address


class Customer(Protocol):
    """A link that wants the messages."""

    outlet: Outlet  #: receives the messages once `source_found` has accepted the publisher

    def source_found(self, header: Mapping[str, str]) -> bool:
        """Called with the publisher's connection header; returns False to refuse its messages."""

    def source_lost(self, reason: str) -> None:
        """Called when the publisher is not reachable or has disconnected."""


class Subscription:
    """Subscribes to one topic of one node on our master while there is a customer.

    Retries with growing pauses while the node does not answer. Each attempt looks up the node's address again, so a
    restarted publisher is found. The subscription is not registered with the master.
    """

    def __init__(self, context: Context, export: Export, emptied: Callable[[], object]) -> None:
        self.topic = export.topic
        self.name = export.subscriber or context.config.node
        self.fanout = Fanout(context.config.max_message_size)
        self._context = context
        self._node = export.source_node
        self._emptied = emptied
        self._customers: list[Customer] = []
        self._header: Mapping[str, str] | None = None
        self._publisher: _Publisher | None = None
        self._timer: Timer | None = None
        self._pause = context.pause()
        self._asking = False
        self._ended = False

    def join(self, customer: Customer) -> None:
        """Adds a customer; the first one starts the subscription."""
        self._customers.append(customer)
        if self._header is not None:
            self._serve(customer)
        elif self._publisher is None and self._timer is None:
            self._ask()

    def leave(self, customer: Customer) -> None:
        """Removes a customer that stays connected; its `left` is called at the end of the current frame."""
        if customer not in self._customers:
            return
        self._customers.remove(customer)
        self.fanout.leave(customer.outlet)
        self.stop_if_unused()

    def remove(self, customer: Customer) -> None:
        """Removes a customer whose connection has ended."""
        if customer in self._customers:
            self._customers.remove(customer)
        self.fanout.remove(customer.outlet)
        self.stop_if_unused()

    def stop_if_unused(self) -> None:
        """Ends the subscription if it has no customers left."""
        if self._ended or self._customers or len(self.fanout):
            return
        self._ended = True
        if self._timer is not None:
            self._timer.cancel()
        if self._publisher is not None:
            publisher, self._publisher = self._publisher, None
            publisher.close("")
        self._emptied()

    def _serve(self, customer: Customer) -> None:
        if self._header is not None and customer.source_found(self._header):
            self.fanout.join(customer.outlet)

    def _ask(self) -> None:
        self._timer = None
        if not self._asking and self._customers:
            self._asking = True
            self._context.master.call(
                "lookupNode", (self._context.config.node, self._node), self._located, self._failed
            )

    def _located(self, uri: Any) -> None:
        arguments = (self.name, self.topic, [["TCPROS"]])
        self._context.server(str(uri)).call("requestTopic", arguments, self._offered, self._failed)

    def _offered(self, answer: Any) -> None:
        offered = offered_address(answer)
        if offered is None:
            self._failed(f"{self._node} offers no TCPROS for {self.topic}")
            return
        host, port = offered
        self._context.resolver.resolve(
            host, lambda address: self._dial(address, port), self._failed
        )

    def _dial(self, address: str, port: int) -> None:
        if self._customers:
            self._publisher = _Publisher(self, self._context, self._node)
            self._publisher.connect(address, port)
        self._asking = False  # only now: if no socket is available, `_failed` follows

    def found(self, header: Mapping[str, str]) -> None:
        """Called with the publisher's connection header."""
        self._header = header
        self._pause.reset()
        self.fanout.begin(header.get("latching") == "1", latch_for(header.get("type", ANY)))
        for customer in tuple(self._customers):
            self._serve(customer)

    def lost(self, publisher: "_Publisher", reason: str) -> None:
        """Called when the publisher's connection has ended."""
        if publisher is not self._publisher:
            return
        self._publisher = self._header = None
        self.fanout.restart()
        for customer in tuple(self._customers):
            self.fanout.remove(customer.outlet)
        self._failed(reason or f"{self._node} closed the connection")

    def _failed(self, reason: str) -> None:
        self._asking = False
        if not self._customers:
            return
        for customer in tuple(self._customers):
            customer.source_lost(reason)
        if self._timer is None:
            self._timer = self._context.reactor.call_later(self._pause.take(), self._ask)


class _Publisher(PublisherConnection):
    """The connection to the publisher."""

    def __init__(self, subscription: Subscription, context: Context, node: str) -> None:
        fields = {
            "callerid": subscription.name,
            "topic": subscription.topic,
            "type": ANY,
            "md5sum": ANY,
        }
        super().__init__(context, node, {**fields, "tcp_nodelay": "1"})
        self._subscription = subscription
        self._context = context

    def greeted(self, header: dict[str, str]) -> None:
        self.fanout = self._subscription.fanout
        self.parse = self.fanout.feed
        self._subscription.found(header)

    def closed(self, reason: str) -> None:
        super().closed(reason)
        if reason.startswith("malformed"):
            self._context.logger.warning(
                "publisher %s of %s: %s", self.peer, self._subscription.topic, reason
            )
        self._subscription.lost(self, reason)
