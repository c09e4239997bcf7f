"""The network interface used by rocon's own tests: this master's gateway and the others, read at each update."""

from gateway_msgs import msg, srv

from rocon_gateway.commands.client import GatewayClient, NoGatewayError


class Graph:
    """The network as this master's gateway knows it. Names are rocon's; its tests also read the private attributes."""

    def __init__(self) -> None:
        self._local_gateway = msg.GatewayInfo()
        self._remote_gateways: list[msg.RemoteGateway] = []

    @property
    def local_gateway(self) -> msg.GatewayInfo:
        """This master's gateway with its rules and connections at the last update; empty until one runs."""
        return self._local_gateway

    @property
    def remote_gateways(self) -> list[msg.RemoteGateway]:
        """The other gateways on its hubs at the last update."""
        return self._remote_gateways

    def update(self) -> None:
        """Queries the gateway again; changes nothing while none runs."""
        try:
            client = GatewayClient()
            local = client.latched("gateway_info", msg.GatewayInfo)
            remote = client.call("remote_gateway_info", srv.RemoteGatewayInfo, gateways=[]).gateways
        except NoGatewayError:
            return
        self._local_gateway, self._remote_gateways = local, list(remote)
