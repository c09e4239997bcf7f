"""What rocon's own tests ask of the network: this master's gateway and the others, read again at each update."""

from gateway_msgs import msg, srv

from rocon_gateway.adapters.client import GatewayClient, NoGatewayError


class Graph:
    """The network as this master's gateway knows it; rocon's names, of which its tests read the private ones."""

    def __init__(self) -> None:
        self._local_gateway = msg.GatewayInfo()
        self._remote_gateways: list[msg.RemoteGateway] = []

    @property
    def local_gateway(self) -> msg.GatewayInfo:
        """This master's gateway, with its rules and connections, as of the last update; empty until one runs."""
        return self._local_gateway

    @property
    def remote_gateways(self) -> list[msg.RemoteGateway]:
        """The other gateways on its hubs, as of the last update."""
        return self._remote_gateways

    def update(self) -> None:
        """Asks the gateway again; while none runs, everything stays as it was."""
        try:
            client = GatewayClient()
            local = client.latched("gateway_info", msg.GatewayInfo)
            remote = client.call("remote_gateway_info", srv.RemoteGatewayInfo, gateways=[]).gateways
        except NoGatewayError:
            return
        self._local_gateway, self._remote_gateways = local, list(remote)
