"""One topic of a proxy node and its subscribers."""

from collections.abc import Mapping
from typing import Protocol

from rocon_relay.adapters.context import Context
from rocon_relay.adapters.registration import Node, Nodes, Owner, Registration
from rocon_relay.core.connection import Import
from rocon_relay.core.pattern import matches_whole
from tcpros.adapters.stream import Stream


class TopicOwner(Owner, Protocol):
    """The importing end behind a topic."""

    def subscribed(self, subscriber: Stream, fields: Mapping[str, str]) -> str:
        """Called with a new subscriber; returns why it is refused, or ""."""

    def unsubscribed(self, subscriber: Stream) -> None:
        """Called when a subscriber has disconnected."""


class ProxyTopic(Registration):
    """A publisher on our master whose source is on another gateway."""

    def __init__(self, context: Context, nodes: Nodes, owner: TopicOwner, wanted: Import) -> None:
        super().__init__(context, nodes, owner, wanted.proxy)
        self.wanted = wanted  #: the import it belongs to; may be replaced by one with the same key
        self.subscribers: dict[Stream, str] = {}  #: connected subscribers, name by connection
        self._topic_owner = owner

    @property
    def type(self) -> str:
        """Its message type."""
        return self.wanted.type

    @property
    def subscriber_names(self) -> list[str]:
        """The names of the connected subscribers."""
        return list(self.subscribers.values())

    def registering(self, node: Node) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method and arguments that register it."""
        return "registerPublisher", (self.wanted.topic, self.wanted.type, node.uri)

    def unregistering(self, node: Node) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method and arguments that unregister it."""
        return "unregisterPublisher", (self.wanted.topic, node.uri)

    def refusal(self, name: str) -> str:
        """Returns why a node of that name may not subscribe, "" if it may."""
        if not self.is_serving:
            return f"{self.wanted.topic} is not relayed any more"
        allowed = self.wanted.allowed_nodes
        if allowed and not any(matches_whole(pattern, name) for pattern in allowed):
            whom = " and ".join(allowed)
            return f"{self.wanted.topic} of {self.wanted.source_gateway} is relayed for {whom} only, not for {name}"
        return ""

    def subscribe(self, subscriber: Stream, fields: Mapping[str, str]) -> str:
        """Accepts a subscriber with its connection header; returns why it is refused, or ""."""
        name = fields.get("callerid", "")
        refusal = self.refusal(name) or self._topic_owner.subscribed(subscriber, fields)
        if not refusal:
            self.subscribers[subscriber] = name
        return refusal

    def unsubscribe(self, subscriber: Stream) -> None:
        """Removes a subscriber whose connection has ended."""
        if self.subscribers.pop(subscriber, None) is not None:
            self._topic_owner.unsubscribed(subscriber)

    def close_disallowed(self) -> None:
        """Closes subscribers that `wanted` no longer allows, after it was replaced."""
        for subscriber, name in tuple(self.subscribers.items()):
            if self.is_serving and self.refusal(name):
                subscriber.close("")

    def close_users(self) -> None:
        """Closes the connections of its users."""
        for subscriber in tuple(self.subscribers):
            subscriber.close("")
