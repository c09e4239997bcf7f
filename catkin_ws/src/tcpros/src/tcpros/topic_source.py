"""A node's subscription: keeps one connection to each publisher that the master lists."""

import socket
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from tcpros.dialled_stream import DialledStream
from tcpros.frame import LENGTH_SIZE
from tcpros.header import header_bytes, header_parser, printable
from tcpros.node_context import NodeContext, Pause
from tcpros.reactor import Timer
from tcpros.stream import message_parser


class Sender(NamedTuple):
    """A publisher as described by its connection header."""

    name: str  #: node name
    latching: bool
    original: str = ""  #: the node whose messages it relays from another master; else its own name


RELAYED_NODE = "relayed_node"
"""Field of a relay's connection header: the name of the publishing node on its own master."""

Taken = Callable[[memoryview, Sender], object]
"""Called with each message and its publisher. The message has no length prefix and is valid only during the call."""


class PublisherConnection(DialledStream):
    """A connection to a publisher, up to the exchange of connection headers.

    Args:
        context: shared by the nodes of the process.
        peer: the publisher, for log lines.
        fields: the subscriber's connection header.
    """

    def __init__(self, context: NodeContext, peer: str, fields: Mapping[str, str]) -> None:
        super().__init__(context.reactor, peer, header_bytes(fields))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        timeout = context.header_timeout
        self._timer = context.reactor.call_later(
            timeout, lambda: self.close("it sent no connection header in time")
        )
        self.parse = header_parser(self._take_header)

    def greeted(self, header: dict[str, str]) -> None:
        """Called with the publisher's connection header; sets the parser for its messages."""
        raise NotImplementedError

    def closed(self, reason: str) -> None:
        """Called once, after the connection has ended for any reason."""
        self._timer.cancel()

    def _take_header(self, header: dict[str, str]) -> None:
        self._timer.cancel()
        if "error" in header:
            self.close(printable(header["error"]))
        else:
            self.greeted(header)


def offered_address(answer: Any) -> tuple[str, int] | None:
    """Returns the host and port in a publisher's answer to requestTopic; None if it offers no TCPROS."""
    try:
        protocol, host, port = answer
        return (str(host), int(port)) if protocol == "TCPROS" else None
    except (TypeError, ValueError):
        return None


class TopicSource:
    """All publishers of one topic.

    Args:
        context: shared by the nodes of the process.
        node: the subscriber's name.
        fields: topic, type and md5sum for the connection header.
        taken: receives the messages.
    """

    def __init__(
        self, context: NodeContext, node: str, fields: dict[str, str], taken: Taken
    ) -> None:
        self.topic = fields["topic"]  #: its resolved name
        self.type = fields["type"]  #: the message type
        self.notifications = 0  #: how often the master has changed the list of publishers
        self._is_closed = False
        self._context = context
        self._node = node
        self._fields = {"callerid": node, "tcp_nodelay": "1", **fields}
        self._taken = taken
        self._publishers: dict[str, _Publisher] = {}

    @property
    def publisher_names(self) -> list[str]:
        """The names of the connected publishers; "" until a publisher's header has arrived."""
        return [
            one.connection.sender.name
            for one in self._publishers.values()
            if one.connection is not None
        ]

    @property
    def headers(self) -> list[dict[str, str]]:
        """The connection headers of the publishers from which one has arrived."""
        connections = [publisher.connection for publisher in self._publishers.values()]
        return [connection.header for connection in connections if connection and connection.header]

    @property
    def received(self) -> list[tuple[str, int]]:
        """The URI of each connected publisher and the bytes of messages received from it."""
        found = ((uri, one.connection) for uri, one in self._publishers.items())
        return [
            (uri, connection.message_bytes) for uri, connection in found if connection is not None
        ]

    def notify(self, publishers: list[str]) -> None:
        """Replaces the list of publishers on a notification of the master."""
        self.notifications += 1
        self.update(publishers)

    def update(self, publishers: list[str]) -> None:
        """Replaces the list of publishers by these URIs; does nothing once closed."""
        if self._is_closed:
            return
        for uri in set(self._publishers) - set(publishers):
            self._publishers.pop(uri).close()
        for uri in publishers:
            if uri not in self._publishers:
                self._publishers[uri] = _Publisher(
                    self._context, uri, self._node, self._fields, self._taken
                )

    def close(self) -> None:
        """Ends all connections."""
        self.update([])
        self._is_closed = True


class _Publisher:
    """One publisher. Connecting is retried with growing pauses until it succeeds or `close` is called."""

    def __init__(
        self, context: NodeContext, uri: str, node: str, fields: dict[str, str], taken: Taken
    ) -> None:
        self._context, self._uri, self._node, self._fields, self._taken = (
            context,
            uri,
            node,
            fields,
            taken,
        )
        self.connection: _Connection | None = None  #: the current connection
        self._pause = Pause()
        self._timer: Timer | None = None
        self._closed = False
        self._reported = False
        self._ask()

    def close(self) -> None:
        """Ends the connection and all attempts."""
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()
        if self.connection is not None:
            self.connection.close("")

    def works(self) -> None:
        """Called when the publisher's first message has arrived."""
        self._pause.reset()
        self._reported = False

    def failed(self, reason: str) -> None:
        """Called when the publisher does not answer, refuses, or has closed the connection; schedules a retry."""
        self.connection = None
        if self._closed:
            return
        if reason and not self._reported:
            topic = self._fields["topic"]
            self._context.logger.warning(
                "%s gets no %s from %s: %s", self._node, topic, self._uri, reason
            )
            self._reported = True
        self._timer = self._context.reactor.call_later(self._pause.take(), self._ask)

    def _ask(self) -> None:
        self._timer = None
        arguments = (self._node, self._fields["topic"], [["TCPROS"]])
        self._context.server(self._uri).call("requestTopic", arguments, self._offered, self.failed)

    def _offered(self, answer: Any) -> None:
        address = offered_address(answer)
        if address is None:
            self.failed(f"it offers an invalid address: {answer!r}")
        else:
            self._context.resolver.resolve(address[0], partial(self._dial, address[1]), self.failed)

    def _dial(self, port: int, address: str) -> None:
        if not self._closed:
            self.connection = _Connection(self._context, self, self._uri, self._fields, self._taken)
            self.connection.connect(address, port)


class _Connection(PublisherConnection):
    """The connection to one publisher."""

    def __init__(
        self,
        context: NodeContext,
        publisher: _Publisher,
        uri: str,
        fields: dict[str, str],
        taken: Taken,
    ) -> None:
        super().__init__(context, uri, fields)
        self._publisher, self._taken = publisher, taken
        self.sender = Sender("", latching=False)  #: the publisher, once its header has arrived
        self.header: dict[str, str] = {}  #: the publisher's, once it has arrived
        self.message_bytes = 0  #: bytes of messages received

    def greeted(self, header: dict[str, str]) -> None:
        """Takes the publisher's connection header."""
        self.header = header
        name = printable(header.get("callerid", ""))
        original = printable(header.get(RELAYED_NODE, name))
        self.sender = Sender(name, header.get("latching") == "1", original)
        self.parse = message_parser(self, self._take)

    def closed(self, reason: str) -> None:
        """Reports the end to the publisher."""
        super().closed(reason)
        self._publisher.failed(reason)

    def _take(self, message: memoryview) -> None:
        if not self.message_bytes:
            # Only now: a connection that is refused after its header must not be retried without a pause.
            self._publisher.works()
        self.message_bytes += LENGTH_SIZE + len(message)
        self._taken(message, self.sender)
