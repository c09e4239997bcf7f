"""Proxy nodes. Each has its own port, where it serves the slave API, subscribers and service clients."""

from rocon_relay.adapters.context import Context
from rocon_relay.adapters.proxy_service import ProxyService
from rocon_relay.adapters.proxy_topic import ProxyTopic
from rocon_relay.adapters.registration import Registration
from rocon_relay.core.connection import proxy_uri
from tcpros.adapters.node_port import Ended, NodePort, RefusedError
from tcpros.adapters.slave_api import NodeFace, SlaveApi
from tcpros.adapters.stream import Stream


class ProxyNodes:
    """The proxy nodes of one relay, by name. A node exists as long as it offers a topic or service."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._nodes: dict[str, ProxyNode] = {}

    def open(self, shown: Registration) -> "ProxyNode":
        """Returns the node that offers `shown`, new or existing."""
        node = self._nodes.get(shown.proxy)
        if node is None:
            node = self._nodes[shown.proxy] = ProxyNode(self._context, shown.proxy)
        if isinstance(shown, ProxyTopic):
            node.topics[shown.wanted.topic] = shown
        elif isinstance(shown, ProxyService):
            node.services[shown.wanted.topic] = shown
        return node

    def release(self, shown: Registration) -> None:
        """Removes `shown` from its node, and closes the node if it offers nothing else."""
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
    """A node on our master that represents a node of another gateway."""

    def __init__(self, context: Context, name: str) -> None:
        self.name = name  #: its name
        self.topics: dict[str, ProxyTopic] = {}  #: its topics by name
        self.services: dict[str, ProxyService] = {}  #: its services by name
        config = context.config
        self._port = NodePort(context.reactor, config.node_bind, self, context.logger, config.handshake_timeout)
        self.port = self._port.number  #: its port, for both protocols
        self.uri = proxy_uri(config.host, self.port, config.gateway)  #: its XML-RPC URI
        face = NodeFace(name, self.uri, config.master_uri, (config.host, self.port), self.topics)
        face.shut_down = lambda _reason: f"{name} is shown by a gateway; take back its rule there to end it"
        self.answer = SlaveApi(face).answer
        self._port.open()

    def close(self) -> None:
        """Closes its port and all its connections."""
        self._port.close()

    def admit_client(self, connection: Stream, fields: dict[str, str]) -> Ended:
        """Accepts a client of a service. Raises RefusedError."""
        service = self.services.get(fields["service"])
        if service is None:
            raise RefusedError(f"{self.name} is not a provider of {fields['service']}")
        return service.call(connection, fields).ended

    def admit_subscriber(self, connection: Stream, fields: dict[str, str]) -> Ended:
        """Accepts a subscriber. Raises RefusedError."""
        topic = self.topics.get(fields.get("topic", ""))
        if topic is None:
            raise RefusedError(f"{self.name} does not publish {fields.get('topic', 'a topic without name')}")
        if refusal := topic.subscribe(connection, fields):
            raise RefusedError(refusal)
        unsubscribe = topic.unsubscribe
        return lambda _reason: unsubscribe(connection)
