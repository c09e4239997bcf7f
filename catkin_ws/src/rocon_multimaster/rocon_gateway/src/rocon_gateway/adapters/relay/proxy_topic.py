"""One topic of a proxy node: registered with our master or not, and the subscribers that it has."""

import enum
import re
from collections.abc import Mapping
from typing import Any, Protocol

from rocon_gateway.adapters.relay.context import Context, Pause
from rocon_gateway.adapters.relay.reactor import Timer
from rocon_gateway.adapters.relay.stream import Stream
from rocon_gateway.core.connection import Import

CLOSE_AFTER = 0.5
"""Subscribers are closed so long after an unregistration was sent, even if the master does not answer [s]."""


class Node(Protocol):
    """The proxy node, as its topics see it."""

    name: str
    uri: str


class Nodes(Protocol):
    """The proxy nodes of a relay."""

    def open(self, topic: "ProxyTopic") -> Node:
        """Returns the node for a topic, listening, with the topic among its own."""

    def release(self, topic: "ProxyTopic") -> None:
        """Takes the topic out of its node, and closes a node without topics."""


class TopicOwner(Protocol):
    """The importing end behind a topic."""

    def subscribed(self, subscriber: Stream, fields: Mapping[str, str]) -> str:
        """A subscriber has come; returns why it is refused, or ""."""

    def unsubscribed(self, subscriber: Stream) -> None:
        """A subscriber has gone."""

    def shown(self) -> None:
        """The topic is registered."""

    def not_shown(self, reason: str) -> None:
        """The master did not register it; it is asked again."""

    def hidden(self) -> None:
        """The topic is unregistered, its subscribers are closed, and it is not to be shown again for now."""


class _Phase(enum.Enum):
    ABSENT = enum.auto()
    REGISTERING = enum.auto()
    PRESENT = enum.auto()
    UNREGISTERING = enum.auto()


class ProxyTopic:
    """Registers and unregisters, one step after the other, so that the last word always wins.

    Whoever subscribes is closed only after the master was told: a rospy subscriber does not come back by itself.

    Attributes:
        wanted: what is shown; replaced by one of the same key.
        subscribers: connected subscribers, name by connection.
        is_serving: whether subscribers are accepted.
    """

    def __init__(self, context: Context, nodes: Nodes, owner: TopicOwner, wanted: Import) -> None:
        self.wanted = wanted
        self.subscribers: dict[Stream, str] = {}
        self.is_serving = False
        self._context = context
        self._nodes = nodes
        self._owner = owner
        self._node: Node | None = None
        self._phase = _Phase.ABSENT
        self._shall_show = False
        self._must_hide = False
        self._pause = Pause(context.config)
        self._retry: Timer | None = None

    def show(self) -> None:
        """Registers the topic, again and again until the master does it."""
        self._shall_show = True
        self._step()

    def hide(self) -> None:
        """Unregisters the topic, then closes its subscribers; the owner's `hidden` follows."""
        self._shall_show = False
        self._must_hide = True
        self.is_serving = False
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None
        if self._phase is _Phase.PRESENT:
            self._context.reactor.call_later(CLOSE_AFTER, self._close_hidden)
        self._step()

    def refresh(self) -> None:
        """Registers once more, if it is registered, for a master that has forgotten it."""
        if self._phase is _Phase.PRESENT:
            self._phase = _Phase.ABSENT
            self._step()

    def refusal(self, name: str) -> str:
        """Returns why a node of that name may not subscribe, "" if it may."""
        if not self.is_serving:
            return f"{self.wanted.topic} is not relayed any more"
        allowed = self.wanted.allowed_nodes
        if allowed and not re.fullmatch(allowed, name):
            return f"{self.wanted.topic} of {self.wanted.source_gateway} is relayed for {allowed} only, not for {name}"
        return ""

    def subscribe(self, subscriber: Stream, fields: Mapping[str, str]) -> str:
        """Takes a subscriber with its connection header; returns why it is refused, or ""."""
        name = fields.get("callerid", "")
        refusal = self.refusal(name) or self._owner.subscribed(subscriber, fields)
        if not refusal:
            self.subscribers[subscriber] = name
        return refusal

    def unsubscribe(self, subscriber: Stream) -> None:
        """Forgets a subscriber whose connection has ended."""
        if self.subscribers.pop(subscriber, None) is not None:
            self._owner.unsubscribed(subscriber)

    def close_disallowed(self) -> None:
        """Closes subscribers that `wanted` does not allow, after it was replaced."""
        for subscriber, name in tuple(self.subscribers.items()):
            if self.is_serving and self.refusal(name):
                subscriber.close("")

    def _close_hidden(self) -> None:
        if not self.is_serving:
            for subscriber in tuple(self.subscribers):
                subscriber.close("")

    def _step(self) -> None:
        if self._phase is _Phase.ABSENT and self._must_hide:
            self._hidden()
        elif self._phase is _Phase.ABSENT and self._shall_show:
            self._register()
        elif self._phase is _Phase.PRESENT and self._must_hide:
            self._phase = _Phase.UNREGISTERING
            self._call("unregisterPublisher", (self.wanted.topic, self._uri()), self._unregistered)

    def _hidden(self) -> None:
        self._must_hide = False
        self._close_hidden()
        if self._node is not None:
            self._node = None
            self._nodes.release(self)
        if self._shall_show:
            self._register()
        else:
            self._owner.hidden()

    def _register(self) -> None:
        if self._node is None:
            self._node = self._nodes.open(self)
        self._retry = None
        self._phase = _Phase.REGISTERING
        self.is_serving = True
        self._call("registerPublisher", (self.wanted.topic, self.wanted.type, self._uri()), self._registered)

    def _uri(self) -> str:
        return self._node.uri if self._node is not None else ""

    def _call(self, method: str, arguments: tuple[str, ...], done: Any) -> None:
        name = self.wanted.proxy
        self._context.master.call(method, (name, *arguments), lambda _value: done(""), done)

    def _registered(self, reason: str) -> None:
        self._phase = _Phase.ABSENT if reason and not self._must_hide else _Phase.PRESENT
        if self._phase is _Phase.PRESENT:
            self._pause.reset()
            if not self._must_hide:
                self._owner.shown()
        elif self._shall_show:
            self._owner.not_shown(reason)
            self._retry = self._context.reactor.call_later(self._pause.take(), self._again)
            return
        self._step()

    def _again(self) -> None:
        self._retry = None
        self._step()

    def _unregistered(self, _reason: str) -> None:
        self._phase = _Phase.ABSENT
        self._step()
