"""A client of the gateway on this master, for command-line tools: it is no node and starts at once."""

import socket
import struct
import xmlrpc.client
from io import BytesIO
from typing import Any

import rosgraph
import rosgraph.network
from gateway_msgs.srv import RemoteGatewayInfo

from rocon_gateway.core.error import GatewayError

CALLER = "/rocon_gateway_tool"
SUFFIX = "/remote_gateway_info"

TIMEOUT = 10.0
"""Within which a gateway must have answered [s]."""


class ClientError(GatewayError):
    """There is no gateway, more than one, or it does not answer."""


class GatewayClient:
    """The one gateway of a master, known by its service of type `gateway_msgs/RemoteGatewayInfo`.

    Raises:
        ClientError: see there; also by each method.
    """

    def __init__(self) -> None:
        self._master = rosgraph.Master(CALLER)
        try:
            services = self._master.getSystemState()[2]
        except OSError as error:
            raise ClientError(
                f"no ROS master at {rosgraph.get_master_uri()} ({error}); is ROS_MASTER_URI right?"
            ) from None
        found = [name for name, _ in services if name.endswith(SUFFIX) and self._is_gateway(name)]
        if not found:
            raise ClientError(f"no gateway runs on the master {rosgraph.get_master_uri()}")
        if len(found) > 1:
            nodes = ", ".join(sorted(name.removesuffix(SUFFIX) for name in found))
            raise ClientError(f"several gateways run on this master ({nodes}): end all but one")
        self.namespace = found[0].removesuffix(SUFFIX)

    def _is_gateway(self, service: str) -> bool:
        try:
            with self._connect_service(service, {"md5sum": "*", "probe": "1"}) as (_, header):
                return header.get("type") == RemoteGatewayInfo._type
        except (ClientError, OSError):
            # Left behind by a gateway that was killed.
            return False

    def call(self, service: str, kind: Any, **fields: Any) -> Any:
        """Calls one of the gateway's services, by its name below the gateway's."""
        request, response = kind._request_class(**fields), kind._response_class()
        body = BytesIO()
        request.serialize(body)
        try:
            with self._connect_service(f"{self.namespace}/{service}", {"md5sum": kind._md5sum}) as (connection, _):
                connection.sendall(struct.pack("<I", len(body.getvalue())) + body.getvalue())
                succeeded = _read(connection, 1) == b"\x01"
                answer = _frame(connection)
        except OSError as error:
            raise ClientError(f"the gateway does not answer: {error}") from None
        if not succeeded:
            raise ClientError(f"the gateway failed: {answer.decode(errors='replace')}")
        return response.deserialize(answer)

    def latched(self, topic: str, kind: Any) -> Any:
        """Returns the last message of one of the gateway's latched topics, by its name below the gateway's."""
        name = f"{self.namespace}/{topic}"
        try:
            with xmlrpc.client.ServerProxy(self._master.lookupNode(self.namespace)) as node:
                code, message, parameters = node.requestTopic(CALLER, name, [["TCPROS"]])
            if code != 1:
                raise ClientError(f"the gateway does not give {name}: {message}")
            with socket.create_connection((parameters[1], parameters[2]), TIMEOUT) as connection:
                _greet(connection, {"topic": name, "type": kind._type, "md5sum": kind._md5sum})
                return kind().deserialize(_frame(connection))
        except (OSError, rosgraph.MasterException, xmlrpc.client.Error) as error:
            raise ClientError(f"the gateway does not answer: {error}") from None

    def _connect_service(self, service: str, header: dict[str, str]) -> "_Greeted":
        try:
            uri = self._master.lookupService(service)
        except rosgraph.MasterException as error:
            raise ClientError(f"there is no service {service}: {error}") from None
        address = rosgraph.network.parse_http_host_and_port(uri.replace("rosrpc", "http", 1))
        return _Greeted(address, {"service": service, **header})


class _Greeted:
    """A connection after the exchange of headers, as a context manager that gives both."""

    def __init__(self, address: tuple[str, int], header: dict[str, str]) -> None:
        self._address, self._header = address, header

    def __enter__(self) -> tuple[socket.socket, dict[str, str]]:
        self._connection = socket.create_connection(self._address, TIMEOUT)
        try:
            return self._connection, _greet(self._connection, self._header)
        except BaseException:
            self._connection.close()
            raise

    def __exit__(self, *_: object) -> None:
        self._connection.close()


def _greet(connection: socket.socket, header: dict[str, str]) -> dict[str, str]:
    rosgraph.network.write_ros_handshake_header(connection, {**header, "callerid": CALLER})
    body = _frame(connection)
    answer = rosgraph.network.decode_ros_handshake_header(struct.pack("<I", len(body)) + body)
    if "error" in answer:
        raise ClientError(f"the gateway refuses: {answer['error']}")
    return dict(answer)


def _frame(connection: socket.socket) -> bytes:
    return _read(connection, *struct.unpack("<I", _read(connection, 4)))


def _read(connection: socket.socket, count: int) -> bytes:
    data = bytearray()
    while len(data) < count:
        part = connection.recv(min(65536, count - len(data)))
        if not part:
            raise ConnectionError("the connection was closed")
        data += part
    return bytes(data)
