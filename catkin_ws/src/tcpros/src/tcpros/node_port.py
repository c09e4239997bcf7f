"""The port of a node, for both XML-RPC and TCPROS: API calls, subscribers and service clients.

roscpp distinguishes publishers by host and port, so two nodes cannot share a port. One node needs only one port for
both protocols: XML-RPC begins with ``POST``, which is out of range as the length of a TCPROS header.
"""

import socket
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Protocol

from tcpros.error import TcprosError
from tcpros.header import header_bytes, header_parser, printable
from tcpros.http import http_message, http_response
from tcpros.listener import Listener
from tcpros.node_context import NodeContext
from tcpros.slave_api import Published, SlaveApi
from tcpros.stream import LARGE_MESSAGE, Stream

MAX_UNIDENTIFIED = 64
"""Maximum number of connections that have not subscribed or called a service; one more closes the oldest."""

Ended = Callable[[str], object]
"""Called with the reason once the connection has ended."""


class RefusedError(TcprosError):
    """A node refuses a subscriber or client; the text is sent to that peer."""


class SubscriberError(TcprosError):
    """A subscriber sent something after its connection header."""


class Offered(Protocol):
    """A service of a node."""

    def admit(self, connection: Stream, fields: dict[str, str]) -> Ended:
        """Accepts a client, or a topic's subscriber, with its connection header. Raises RefusedError."""


class Topic(Published, Offered, Protocol):
    """A topic that a node publishes."""


class NodePort:
    """A node's listening port, its connections and its slave API.

    Args:
        context: shared by the nodes of the process.
        name: the node's name.
        topics: the published topics by name; the node may change them at any time.
        services: the services by name, likewise.

    Raises:
        OSError: no port is available.
    """

    def __init__(
        self,
        context: NodeContext,
        name: str,
        topics: Mapping[str, Topic],
        services: Mapping[str, Offered],
    ) -> None:
        self.context = context
        self._listener = Listener(context.reactor, context.bind, 0, self._accepted)
        self._topics, self._services = topics, services
        self._connections: set[NodeConnection] = set()
        self._unidentified: dict[NodeConnection, None] = {}
        self.number = self._listener.port  #: the port's number
        uri = f"http://{context.host}:{self.number}/"
        self.api = SlaveApi(
            name, uri, context.master_uri, (context.host, self.number), topics
        )  #: the slave API

    def open(self) -> None:
        """Starts accepting connections."""
        self._listener.start()

    def close(self) -> None:
        """Closes the port and all its connections."""
        self._listener.close("")
        for connection in tuple(self._connections):
            connection.close("")

    def forget(self, connection: "NodeConnection") -> None:
        """Called by a connection that has ended."""
        self._connections.discard(connection)
        self.know(connection)

    def admit(self, connection: "NodeConnection", fields: dict[str, str]) -> Ended:
        """Passes a subscriber or client on to the topic or service that it names. Raises RefusedError."""
        offered: Offered | None
        if "service" in fields:
            offered, lacks = (
                self._services.get(fields["service"]),
                f"is not a provider of {fields['service']}",
            )
        else:
            topic = fields.get("topic", "a topic without name")
            offered, lacks = self._topics.get(topic), f"does not publish {topic}"
        if offered is None:
            raise RefusedError(f"{self.api.name} {lacks}")
        return offered.admit(connection, fields)

    def know(self, connection: "NodeConnection") -> None:
        """Called by a connection that has subscribed or called a service and so no longer counts as unidentified."""
        self._unidentified.pop(connection, None)

    def _accepted(self, sock: socket.socket, peer: str) -> None:
        connection = NodeConnection(self, sock, peer)
        self._connections.add(connection)
        self._unidentified[connection] = None
        if len(self._unidentified) > MAX_UNIDENTIFIED:
            next(iter(self._unidentified)).give_up(
                "too many connections without a connection header"
            )


class NodeConnection(Stream):
    """One connection to a node, of either protocol."""

    def __init__(self, port: NodePort, sock: socket.socket, peer: str) -> None:
        super().__init__(port.context.reactor, sock, peer)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._port = port
        self._ended: Ended | None = None
        self._asked = 0.0
        self._timer = port.context.reactor.call_later(port.context.header_timeout, self._too_late)
        self.parse = self._parse_first

    def give_up(self, reason: str) -> None:
        """Closes an unidentified connection. Not logged if it is just an idle connection that has made API calls."""
        self.close("" if self._asked else f"malformed: {reason}")

    def closed(self, reason: str) -> None:
        """Notifies the topic or service that owns the connection."""
        self._timer.cancel()
        if reason.startswith("malformed"):
            self._port.context.logger.warning(
                "%s from %s: %s", self._port.api.name, self.peer, reason
            )
        if self._ended is not None:
            self._ended(reason)
        self._port.forget(self)

    def _too_late(self) -> None:
        left = self._asked + self._port.context.header_timeout - time.monotonic()
        if left > 0:
            self._timer = self._reactor.call_later(left, self._too_late)
        else:
            self.give_up("timed out waiting for its connection header")

    def _parse_first(self, data: memoryview) -> int:
        if len(data) < 4:
            return 0
        if data[:4] == b"POST":
            self.parse, self.relieved = self._parse_http, self.read_on
        else:
            self.parse = header_parser(self._take_header)
        return self.parse(data)

    def _take_header(self, fields: dict[str, str]) -> None:
        self._timer.cancel()
        self._port.know(self)
        self.parse = self._parse_nothing
        try:
            ended = self._port.admit(self, fields)
        except RefusedError as error:
            self.finish(header_bytes({"error": printable(str(error))}))
            return
        if self.is_closed:  # closed while the response was being sent
            ended("")
        else:
            self._ended = ended

    def _parse_nothing(self, data: memoryview) -> int:
        raise SubscriberError("it sent unexpected data after subscribing")

    def _parse_http(self, data: memoryview) -> int:
        if not self.backlog.is_empty:
            self.hold()  # a client that sends requests but reads no responses would fill our memory
            return 0
        message = http_message(data, 0)
        if message is None:
            return 0
        answer = partial(self._answer_call, message.keep_alive)
        if message.end <= len(data):
            answer(data[message.start : message.end])
            return message.end
        if message.length > LARGE_MESSAGE:
            self.collect(message.length, answer)
            return message.start
        return 0

    def _answer_call(self, keep_alive: bool, request: memoryview) -> None:
        self._asked = time.monotonic()
        response = http_response(self._port.api.answer(bytes(request)), keep_alive)
        if keep_alive:
            self.send(response)
        else:
            self.finish(response)
