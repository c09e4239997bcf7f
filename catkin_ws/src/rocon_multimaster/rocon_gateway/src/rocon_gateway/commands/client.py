"""A client of the gateway on this master, for command-line tools. It is not a ROS node, so it starts fast."""

import contextlib
from collections.abc import Iterator
from typing import Any

import rosgraph
from gateway_msgs.srv import RemoteGatewayInfo

from rocon_gateway.error import GatewayError
from tcpros.client import Client, ClientError

SUFFIX = "/remote_gateway_info"


class NoGatewayError(GatewayError):
    """There is no gateway, more than one, or it does not answer."""


class GatewayClient:
    """The one gateway of a master, found by its service of type `gateway_msgs/RemoteGatewayInfo`.

    Raises:
        NoGatewayError: see there; also raised by each method.
    """

    def __init__(self) -> None:
        uri = rosgraph.get_master_uri()
        self._client = Client(uri, "/rocon_gateway_tool")
        try:
            services = self._client.ask_master("getSystemState")[2]
        except (ClientError, OSError) as error:
            raise NoGatewayError(
                f"no ROS master at {uri} ({error}); is ROS_MASTER_URI right?"
            ) from None
        found = [name for name, _ in services if name.endswith(SUFFIX) and self._is_gateway(name)]
        if not found:
            raise NoGatewayError(f"no gateway runs on the master {uri}")
        if len(found) > 1:
            nodes = ", ".join(sorted(name.removesuffix(SUFFIX) for name in found))
            raise NoGatewayError(f"several gateways run on this master ({nodes}): end all but one")
        self.namespace = found[0].removesuffix(SUFFIX)

    def _is_gateway(self, service: str) -> bool:
        try:
            with self._client.service(service, "*", probe="1") as connection:
                return connection.header.get("type") == RemoteGatewayInfo._type
        except (ClientError, OSError):
            return False  # a killed gateway leaves its services on the master

    def call(self, service: str, kind: Any, **fields: Any) -> Any:
        """Calls one of the gateway's services, given its name relative to the gateway's."""
        with _reporting():
            return self._client.call(f"{self.namespace}/{service}", kind, **fields)

    def latched(self, topic: str, kind: Any) -> Any:
        """Returns the last message of one of the gateway's latched topics, given its name relative to the gateway's."""
        with _reporting():
            return self._client.latched(self.namespace, f"{self.namespace}/{topic}", kind)


@contextlib.contextmanager
def _reporting() -> Iterator[None]:
    try:
        yield
    except ClientError as error:
        raise NoGatewayError(f"the gateway returned an error: {error}") from None
    except OSError as error:
        raise NoGatewayError(f"the gateway does not answer: {error}") from None
