"""A ROS node on a reactor. One process can host several, each with its own name, port and slave API.

Supports topics, services, the slave API for tools, and shutdown on request. The `NodeHandle` of `pioneer_node` adds
the rest of a rospy node: name resolution, parameters, ROS time, ``/rosout``.
"""

import threading
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from tcpros.error import TcprosError
from tcpros.fanout import Fanout
from tcpros.frame import MAX_MESSAGE
from tcpros.header import header_bytes, printable
from tcpros.node_context import NodeContext
from tcpros.node_port import Ended, NodePort, RefusedError
from tcpros.reactor import Reactor
from tcpros.service_call import failure
from tcpros.stream import Stream, message_parser
from tcpros.topic_source import Taken, TopicSource
from tcpros.xmlrpc_client import NoAnswer

QUEUE_MESSAGES, QUEUE_BYTES = 100, 2**20
"""Queue limits for one slow subscriber; beyond them, the oldest messages are dropped."""

ASK_AGAIN = 0.5
"""Retry interval while the master does not answer [s]."""


class ServiceError(TcprosError):
    """A service call failed; the text is sent to the client."""


class Publication:
    """A topic that a node publishes."""

    def __init__(self, name: str, topic: str, kind: Any, latching: bool) -> None:
        self.type = kind._type  #: its message type
        self.subscribers: dict[Stream, str] = {}  #: subscriber names by connection
        self._md5sum = kind._md5sum
        self._latching = latching
        self._fanout = Fanout(MAX_MESSAGE)
        self._fanout.begin(latching)
        self._header = header_bytes(
            {
                "callerid": name,
                "latching": str(int(latching)),
                "md5sum": kind._md5sum,
                "message_definition": kind._full_text,
                "topic": topic,
                "type": kind._type,
            }
        )

    def is_like(self, kind: Any, latching: bool) -> bool:
        """Returns whether another publication with these arguments would be the same."""
        return self._md5sum == kind._md5sum and self._latching == latching

    def refusal(self, name: str) -> str:
        """Returns "": every node may subscribe."""
        del name
        return ""

    def send(self, frame: bytes) -> None:
        """Sends a frame (length and serialized message) to all subscribers."""
        self._fanout.feed(memoryview(frame))

    def close(self) -> None:
        """Closes the connections of all subscribers."""
        for connection in tuple(self.subscribers):
            connection.close("")

    def admit(self, connection: Stream, fields: Mapping[str, str]) -> Ended:
        """Accepts a subscriber with its connection header. Raises RefusedError if the type differs."""
        for field, ours in (("md5sum", self._md5sum), ("type", self.type)):
            if fields.get(field, "*") not in ("*", ours):
                raise RefusedError(f"the topic's {field} is {ours}, not {fields[field]}")
        self.subscribers[connection] = printable(fields.get("callerid", ""))
        connection.send(self._header)
        connection.backlog.bound(QUEUE_MESSAGES, QUEUE_BYTES, drops_first=True)
        self._fanout.join(connection)

        def ended(_reason: str) -> None:
            self._fanout.remove(connection)
            del self.subscribers[connection]

        return ended


class Service:
    """A service of a node.

    Args:
        name: name of the node.
        kind: the service class.
        answer: turns a serialised request into a response frame.
        reactor: given if ``answer`` may block; each call then runs in its own thread. None calls it directly.
    """

    def __init__(
        self, name: str, kind: Any, answer: Callable[[bytes], bytes], reactor: Reactor | None = None
    ) -> None:
        self._answer, self._reactor = answer, reactor
        self._md5sum = kind._md5sum
        self._header = header_bytes({"callerid": name, "md5sum": kind._md5sum, "type": kind._type})

    def admit(self, connection: Stream, fields: Mapping[str, str]) -> Ended:
        """Accepts a client with its connection header. Raises RefusedError if the type differs."""
        if fields.get("md5sum", "*") not in ("*", self._md5sum):
            raise RefusedError(f"the service's md5sum is {self._md5sum}, not {fields['md5sum']}")
        persistent = fields.get("persistent", "") in ("1", "true", "True")

        def send(answer: bytes) -> None:
            if connection.is_closed:
                return
            if not persistent:
                connection.finish(answer)
                return
            connection.send(answer)
            if not connection.is_reading:
                connection.read_on()

        def take(data: memoryview) -> None:
            request = bytes(data)
            if self._reactor is None:
                send(self._answered(request))
            else:
                connection.hold()  # one request at a time
                thread = threading.Thread(
                    target=self._answer_later, args=(request, send), daemon=True
                )
                try:
                    thread.start()
                except RuntimeError as error:  # no more threads on this machine
                    send(failure(f"the request is not processed: {error}"))

        connection.send(self._header)
        connection.parse = message_parser(connection, take)
        return lambda _reason: None

    def _answer_later(self, request: bytes, send: Callable[[bytes], None]) -> None:
        assert self._reactor is not None, "only then"
        self._reactor.call(partial(send, self._answered(request)))

    def _answered(self, request: bytes) -> bytes:
        try:
            return b"\x01" + self._answer(request)
        except ServiceError as error:
            return failure(str(error))


class _Watched:
    """A parameter to which a node is subscribed; calling it passes on a new value."""

    def __init__(self) -> None:
        self.notifications = 0  #: how often the master has sent a value
        self.callbacks: list[Callable[[Any], object]] = []

    def __call__(self, value: Any) -> None:
        self.notifications += 1
        for changed in tuple(self.callbacks):
            changed(value)


def _ignore(_: object) -> None:
    """Does nothing."""


class Node:
    """One node. All methods must be called in the reactor's thread.

    Args:
        context: shared with the other nodes of the process.
        name: its resolved name.
        shut_down: called with the reason when the node has to shut down; the callee then calls `close`.
    """

    def __init__(self, context: NodeContext, name: str, shut_down: Callable[[str], object]) -> None:
        self.name = name
        self._context = context
        self._shut_down = shut_down
        self._published: dict[str, Publication] = {}
        self._advertised = Counter[str]()  #: how often each topic is advertised
        self._subscribed: dict[str, list[TopicSource]] = {}
        self._left: set[str] = set()
        self._withdrawn: set[str] = set()
        # Topics whose unregistration is not answered yet; only then are they registered again.
        self._leaving: set[str] = set()
        self._withdrawing: set[str] = set()
        self._services: dict[str, Service] = {}
        self._watched: dict[str, _Watched] = {}
        self._unanswered = self._in_flight = 0
        self._repetitions = 0  # of all registrations, at restarted masters
        self._unregister: Callable[[], object] | None = None
        self._is_unheard = self._is_closing = False
        self._registered: list[Callable[[], object]] = []
        self._port = NodePort(context, name, self._published, self._services)
        self.uri = self._port.api.uri  #: URI of its slave API
        self._service_uri = f"rosrpc://{context.host}:{self._port.number}"
        self._port.api.subscribed, self._port.api.parameters = self._subscribed, self._watched
        self._port.api.shut_down = self._asked_to_end
        self._port.open()

    def publish(self, topic: str, kind: Any, latching: bool = False) -> Publication:
        """Advertises a topic, given its resolved name; returns the publication.

        A topic that is advertised again in the same way has one publication, until it is withdrawn as often.
        """
        publication = self._published.get(topic)
        self._advertised[topic] += 1
        if publication is not None and publication.is_like(kind, latching):
            return publication
        publication = self._published[topic] = Publication(self.name, topic, kind, latching)
        self._register_publisher(topic)
        return publication

    def unpublish(self, topic: str) -> None:
        """Withdraws a published topic, once for each time that it was advertised."""
        self._advertised[topic] -= 1
        if self._advertised[topic] > 0:
            return
        del self._advertised[topic]
        self._published.pop(topic).close()
        self._withdrawn.add(topic)
        # The master may execute calls in another order than they were made.
        self.when_registered(self._unregister_withdrawn)

    def _unregister_withdrawn(self) -> None:
        withdrawn = self._withdrawn - self._published.keys()
        self._withdrawn = set()
        for topic in withdrawn:
            self._withdrawing.add(topic)
            confirmed = partial(self._withdrawing.discard, topic)
            done = partial(self._has_withdrawn, topic)
            self._register("unregisterPublisher", topic, self.uri, confirmed=confirmed, done=done)

    def _has_withdrawn(self, topic: str, _value: Any) -> None:
        if topic in self._published:
            self._register_publisher(topic)

    def _register_publisher(self, topic: str) -> None:
        if topic not in self._withdrawing:
            self._register("registerPublisher", topic, self._published[topic].type, self.uri)

    def subscribe(self, topic: str, kind: Any, taken: Taken) -> TopicSource:
        """Subscribes to a topic, given its resolved name; returns the subscription's connections.

        Further subscriptions of a topic have connections of their own, so that each gets the latched messages.
        """
        fields = {"topic": topic, "type": kind._type, "md5sum": kind._md5sum}
        source = TopicSource(self._context, self.name, fields, taken)
        self._subscribed.setdefault(topic, []).append(source)
        self._register_subscriber(source)
        return source

    def _register_subscriber(self, source: TopicSource) -> None:
        if source.topic not in self._leaving:
            self._ask_for_state(
                "registerSubscriber",
                (source.topic, source.type, self.uri),
                lambda: source.notifications,
                source.update,
            )

    def unsubscribe(self, source: TopicSource) -> None:
        """Ends a subscription."""
        source.close()
        sources = self._subscribed[source.topic]
        sources.remove(source)
        if sources:
            return
        del self._subscribed[source.topic]
        self._left.add(source.topic)
        # The master may execute calls in another order than they were made.
        self.when_registered(self._unregister_left)

    def _unregister_left(self) -> None:
        left, self._left = self._left - self._subscribed.keys(), set()
        for topic in left:
            self._leaving.add(topic)
            confirmed = partial(self._leaving.discard, topic)
            done = partial(self._has_left, topic)
            self._register("unregisterSubscriber", topic, self.uri, confirmed=confirmed, done=done)

    def _has_left(self, topic: str, _value: Any) -> None:
        for source in self._subscribed.get(topic, ()):
            self._register_subscriber(source)

    def watch(self, parameter: str, changed: Callable[[Any], object]) -> None:
        """Subscribes to a parameter: calls ``changed`` with its value now and whenever it is set.

        The name must be resolved. The value of an unset parameter is an empty dictionary.
        """
        watched = self._watched.setdefault(parameter, _Watched())
        watched.callbacks.append(changed)
        self._ask_for_state(
            "subscribeParam", (self.uri, parameter), lambda: watched.notifications, changed
        )

    def serve(
        self, service: str, kind: Any, answer: Callable[[bytes], bytes], may_wait: bool = False
    ) -> None:
        """Advertises a service.

        Args:
            service: its resolved name.
            kind: its class.
            answer: turns a serialised request into a response frame.
            may_wait: whether ``answer`` may block; each call then runs in its own thread.
        """
        self._services[service] = Service(
            self.name, kind, answer, self._context.reactor if may_wait else None
        )
        self._register("registerService", service, self._service_uri, self.uri)

    def when_registered(self, done: Callable[[], object]) -> None:
        """Calls ``done`` once all current registrations are confirmed by the master."""
        self._registered.append(done)
        self._answered(0)

    def register_again(self) -> None:
        """Repeats all registrations at a restarted master, each until it is answered; refusals are ignored.

        The next call of this takes the place of one that is not answered yet.
        """
        # What is withdrawn meanwhile is unregistered afterwards: see `_unregister_withdrawn`.
        self._repetitions += 1
        repeat = partial(self._register, repetition=self._repetitions)
        for topic, publication in self._published.items():
            repeat("registerPublisher", topic, publication.type, self.uri)
        for topic, sources in self._subscribed.items():
            for source in sources:
                names = (topic, source.type, self.uri)
                repeat("registerSubscriber", *names, done=source.update, notified=source)
        for service in self._services:
            repeat("registerService", service, self._service_uri, self.uri)
        for parameter, watched in self._watched.items():
            repeat("subscribeParam", self.uri, parameter, done=watched, notified=watched)

    def close(self, done: Callable[[], object]) -> None:
        """Unregisters everything from the master, closes all connections, then calls ``done``."""
        self._is_closing = True
        for sources in self._subscribed.values():
            for source in sources:
                source.close()
        # The master may execute calls in another order than they were made.
        self._unregister = partial(self._unregister_all, done)
        self._unregister_when_answered()

    def _unregister_when_answered(self) -> None:
        if not self._in_flight and self._unregister is not None:
            unregister, self._unregister = self._unregister, None
            unregister()

    def _unregister_all(self, done: Callable[[], object]) -> None:
        calls = [
            ("unregisterPublisher", topic, self.uri)
            for topic in self._published.keys() | self._withdrawn | self._withdrawing
        ]
        calls += [
            ("unregisterSubscriber", topic, self.uri)
            for topic in self._subscribed.keys() | self._left | self._leaving
        ]
        calls += [("unregisterService", service, self._service_uri) for service in self._services]
        calls += [("unsubscribeParam", self.uri, parameter) for parameter in self._watched]
        missing = len(calls)

        def close_port() -> None:
            self._port.close()
            done()

        def answered(_: object) -> None:
            nonlocal missing
            missing -= 1
            if not missing:
                close_port()

        if not calls:
            close_port()

        for method, *arguments in calls:
            self._context.master.call(method, (self.name, *arguments), answered, answered)

    def _asked_to_end(self, reason: str) -> str:
        # Deferred, so that the response is sent first.
        self._context.reactor.call_later(0.0, lambda: self._shut_down(reason or "asked to end"))
        return ""

    def _ask_for_state(
        self,
        method: str,
        arguments: tuple[str, ...],
        notifications: Callable[[], int],
        done: Callable[[Any], object],
    ) -> None:
        """Registers for notifications of the master, which answers with the present state.

        The answer may be older than a notification that has come before it, so the master is then asked again.
        """
        before = notifications()

        def answered(value: Any) -> None:
            if notifications() == before:
                done(value)
            else:
                self._ask_for_state(method, arguments, notifications, done)

        self._register(method, *arguments, done=answered)

    def _register(
        self,
        method: str,
        *arguments: str,
        done: Callable[[Any], object] = _ignore,
        confirmed: Callable[[], object] | None = None,
        notified: "TopicSource | _Watched | None" = None,
        repetition: int = 0,
    ) -> None:
        """Registers at the master, retrying until it answers, like rospy. If it refuses, the node shuts down.

        Args:
            method: of the master.
            arguments: those after the node's name.
            done: called with the answer, unless the node ends.
            confirmed: called when it is answered, also while the node ends.
            notified: an answer that is older than a notification of this is dropped.
            repetition: number of the repetition that this is part of, 0 for none. It may be refused, and ends with the
                next repetition.
        """

        def ask() -> None:
            if not self._is_closing:
                self._in_flight += 1
                before = notified.notifications if notified is not None else 0
                self._context.master.call(
                    method, (self.name, *arguments), partial(answered, before), failed
                )

        def failed(reason: str) -> None:
            self._in_flight -= 1
            self._unregister_when_answered()
            if self._is_closing:
                return
            is_refused = not isinstance(reason, NoAnswer)
            if repetition and (is_refused or repetition != self._repetitions):
                self._answered(1)
                return
            if is_refused:
                self._shut_down(f"{method} of {' '.join(arguments[:2])} failed: {reason}")
                return
            if not self._is_unheard:
                self._context.logger.warning(
                    "%s: the master does not answer and is asked again: %s", self.name, reason
                )
            self._is_unheard = True
            self._context.reactor.call_later(ASK_AGAIN, ask)

        def answered(before: int, value: Any) -> None:
            if confirmed is not None:
                confirmed()
            self._in_flight -= 1
            self._unregister_when_answered()
            if self._is_closing:
                return
            self._is_unheard = False
            if notified is None or notified.notifications == before:
                done(value)
            self._answered(1)

        self._unanswered += 1
        ask()

    def _answered(self, count: int) -> None:
        self._unanswered -= count
        if not self._unanswered:
            waiting, self._registered = self._registered, []
            for done in waiting:
                done()
