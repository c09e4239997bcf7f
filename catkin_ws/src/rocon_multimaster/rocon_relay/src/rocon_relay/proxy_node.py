"""Proxy nodes. Each has its own port, where it serves the slave API, subscribers and service clients."""

from rocon_relay.connection import proxy_uri
from rocon_relay.context import Context
from tcpros.node_port import NodePort, Offered, Topic


class ProxyNodes:
    """The proxy nodes of one relay, by name. A node exists as long as it offers a topic or service."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._nodes: dict[str, ProxyNode] = {}

    def open(self, name: str) -> "ProxyNode":
        """Returns the node of that name, new or existing. Raises OSError if its port cannot be opened."""
        if name not in self._nodes:
            self._nodes[name] = ProxyNode(self._context, name)
        return self._nodes[name]

    def close_unused(self, node: "ProxyNode") -> None:
        """Closes the node if it offers nothing."""
        if not node.topics and not node.services and self._nodes.get(node.name) is node:
            del self._nodes[node.name]
            node.close()


class ProxyNode:
    """A node on our master that represents a node of another gateway."""

    def __init__(self, context: Context, name: str) -> None:
        self.name = name  #: its name
        self.topics: dict[str, Topic] = {}  #: its topics by name
        self.services: dict[str, Offered] = {}  #: its services by name
        self._logger = context.logger
        config = context.config
        self._port = NodePort(context, name, self.topics, self.services)
        self.service_uri = (
            f"rosrpc://{config.host}:{self._port.number}"  #: the address of its services
        )
        self.uri = proxy_uri(config.host, self._port.number, config.gateway)  #: its XML-RPC URI
        self._port.api.uri = self.uri
        self._port.api.shut_down = self._refuse_to_end
        self._port.open()

    def _refuse_to_end(self, reason: str) -> str:
        """Returns why it does not end; logs it, because `rosnode kill` reports a success whatever a node answers."""
        refusal = f"{self.name} is shown by a gateway; take back its rule there to end it"
        self._logger.warning("asked to shut down (%s): %s", reason, refusal)
        return refusal

    def close(self) -> None:
        """Closes its port and all its connections."""
        self._port.close()
