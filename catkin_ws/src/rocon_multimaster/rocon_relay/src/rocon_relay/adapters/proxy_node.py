"""Proxy nodes: each with a port of its own, where it answers as a ROS node and serves its subscribers.

roscpp tells publishers apart by host and port, so no two nodes may share a port. One port does for both
protocols of a node: XML-RPC begins with `POST`, which as the length of a TCPROS header is out of bounds.
"""

import socket
import time

from rocon_relay.adapters.context import Context, Tenant
from rocon_relay.adapters.proxy_service import ProxyService
from rocon_relay.adapters.proxy_topic import ProxyTopic
from rocon_relay.adapters.registration import Registration
from rocon_relay.adapters.slave_api import SlaveApi
from rocon_relay.core.connection import proxy_uri
from rocon_relay.core.error import RelayError
from tcpros.adapters.listener import Listener
from tcpros.adapters.reactor import Timer
from tcpros.adapters.stream import Stream
from tcpros.core.header import header_bytes, header_parser
from tcpros.core.http import http_message, http_response

MAX_UNIDENTIFIED = 64
"""Connections to one proxy that do not, or not yet, subscribe or call a service; one more closes the oldest."""


class SubscriberError(RelayError):
    """A subscriber sent something after its connection header."""


class ProxyNodes:
    """The proxy nodes of one relay, by name; a node lives while it shows a topic or service."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._nodes: dict[str, ProxyNode] = {}

    def open(self, shown: Registration) -> "ProxyNode":
        """Returns the node for a source node, new or existing."""
        node = self._nodes.get(shown.proxy)
        if node is None:
            node = self._nodes[shown.proxy] = ProxyNode(self._context, shown.proxy)
        if isinstance(shown, ProxyTopic):
            node.topics[shown.wanted.topic] = shown
        elif isinstance(shown, ProxyService):
            node.services[shown.wanted.topic] = shown
        return node

    def release(self, shown: Registration) -> None:
        """Closes a node that nothing uses any more."""
        node = self._nodes.get(shown.proxy)
        if node is None:
            return
        if isinstance(shown, ProxyTopic) and node.topics.get(shown.wanted.topic) is shown:
            del node.topics[shown.wanted.topic]
        elif isinstance(shown, ProxyService) and node.services.get(shown.wanted.topic) is shown:
            del node.services[shown.wanted.topic]
        if not node.topics and not node.services:
            del self._nodes[node.name]
            node.close()


class ProxyNode:
    """A node on our master that stands for a node of another gateway."""

    def __init__(self, context: Context, name: str) -> None:
        self.name = name  #: its name
        self.topics: dict[str, ProxyTopic] = {}  #: its topics by name
        self.services: dict[str, ProxyService] = {}  #: its services by name
        self._context = context
        config = context.config
        self._listener = Listener(context.reactor, config.node_bind, 0, self._accepted)
        self._connections: set[ProxyConnection] = set()
        self._unidentified: dict[ProxyConnection, None] = {}
        self.port = self._listener.port  #: its port, for both protocols
        self.uri = proxy_uri(config.host, self.port, config.gateway)  #: its XML-RPC URI
        self.api = SlaveApi(self.name, self.uri, config.master_uri, config.host, self.port, self.topics)
        self._listener.start()

    def close(self) -> None:
        """Closes its port and all its connections."""
        self._listener.close("")
        for connection in tuple(self._connections):
            connection.close("")

    def forget(self, connection: "ProxyConnection") -> None:
        """Called by a connection that has ended."""
        self._connections.discard(connection)
        self.know(connection)

    def know(self, connection: "ProxyConnection") -> None:
        """Called by a connection that subscribes or calls, and is counted as what it is from now on."""
        self._unidentified.pop(connection, None)

    def _accepted(self, sock: socket.socket, peer: str) -> None:
        connection = ProxyConnection(self._context, self, sock, peer)
        self._connections.add(connection)
        self._unidentified[connection] = None
        if len(self._unidentified) > MAX_UNIDENTIFIED:
            next(iter(self._unidentified)).give_up("too many connections that have not said what they want")


class ProxyConnection(Stream):
    """One connection to a proxy node, of either protocol."""

    def __init__(self, context: Context, node: ProxyNode, sock: socket.socket, peer: str) -> None:
        super().__init__(context.reactor, sock, peer)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._context = context
        self._node = node
        self._topic: ProxyTopic | None = None
        self._call: Tenant | None = None
        self._asked = 0.0
        self._timer: Timer = context.reactor.call_later(context.config.handshake_timeout, self._too_late)
        self.parse = self._parse_first

    def give_up(self, reason: str) -> None:
        """Closes a connection of no subscriber; an idle one that was answered is not a fault worth a log line."""
        self.close("" if self._asked else f"malformed: {reason}")

    def closed(self, reason: str) -> None:
        """Removes the connection from its topic or service."""
        self._timer.cancel()
        if reason.startswith("malformed"):
            self._context.logger.warning("%s from %s: %s", self._node.name, self.peer, reason)
        if self._topic is not None:
            self._topic.unsubscribe(self)
        if self._call is not None:
            self._call.ended(reason)
        self._node.forget(self)

    def _too_late(self) -> None:
        left = self._asked + self._context.config.handshake_timeout - time.monotonic()
        if left > 0:
            self._timer = self._context.reactor.call_later(left, self._too_late)
        else:
            self.give_up("it did not say in time what it wants")

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
        self._node.know(self)
        self.parse = self._parse_nothing
        if "service" in fields:
            self._serve(fields)
        else:
            self._subscribe(fields)

    def _serve(self, fields: dict[str, str]) -> None:
        service = self._node.services.get(fields["service"])
        if service is None:
            self.finish(header_bytes({"error": f"{self._node.name} is not a provider of {fields['service']}"}))
        else:
            self._call = service.call(self, fields)

    def _subscribe(self, fields: dict[str, str]) -> None:
        topic = self._node.topics.get(fields.get("topic", ""))
        if topic is None:
            refusal = f"{self._node.name} does not publish {fields.get('topic', 'a topic without name')}"
        else:
            refusal = topic.subscribe(self, fields)
        if refusal:
            self.finish(header_bytes({"error": refusal}))
        elif topic is not None and self.is_closed:  # it went while it was answered
            topic.unsubscribe(self)
        else:
            self._topic = topic

    def _parse_nothing(self, data: memoryview) -> int:
        raise SubscriberError("it sends though it subscribes")

    def _parse_http(self, data: memoryview) -> int:
        if not self.backlog.is_empty:
            self.hold()  # who asks and asks and takes no answer would have us keep them all
            return 0
        message = http_message(data, 0)
        if message is None or len(data) < message.end:
            return 0
        self._asked = time.monotonic()
        body = self._node.api.answer(bytes(data[message.start : message.end]))
        response = http_response(body, message.keep_alive)
        if message.keep_alive:
            self.send(response)
        else:
            self.finish(response)
        return message.end
