"""A client of services and latched topics of any master: a process can be only one ROS node, on one master."""

import socket
import struct
import xmlrpc.client
from io import BytesIO
from typing import Any

import rosgraph

CALLER = "/bench"
TIMEOUT = 10.0
"""For any answer [s]."""


class Caller:
    """A connection to a service: for one call, or any number if it is persistent."""

    def __init__(self, master: rosgraph.Master, service: str, kind: Any, persistent: bool = False) -> None:
        uri = master.lookupService(service).replace("rosrpc", "http")
        header = {"service": service, "md5sum": kind._md5sum, "callerid": CALLER}
        self._service, self._kind = service, kind
        self._connection = socket.create_connection(rosgraph.network.parse_http_host_and_port(uri), TIMEOUT)
        self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        _greet(self._connection, {**header, "persistent": "1"} if persistent else header)

    def __enter__(self) -> "Caller":
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def call(self, **fields: Any) -> Any:
        """Returns the response; raises OSError with the server's words if that fails."""
        request, response = BytesIO(), self._kind._response_class()
        self._kind._request_class(**fields).serialize(request)
        self._connection.sendall(struct.pack("<I", len(request.getvalue())) + request.getvalue())
        good, body = _read(self._connection, 1) == b"\x01", _frame(self._connection)
        if not good:
            raise OSError(f"{self._service}: {body.decode(errors='replace')}")
        response.deserialize(body)
        return response


def call(master: rosgraph.Master, service: str, kind: Any, **fields: Any) -> Any:
    """Calls a service of type `kind` once and returns its response."""
    with Caller(master, service, kind) as caller:
        return caller.call(**fields)


def latched(master: rosgraph.Master, node: str, topic: str, kind: Any) -> Any:
    """Returns the message of type `kind` that a node keeps for each new subscriber."""
    with xmlrpc.client.ServerProxy(master.lookupNode(node)) as slave:
        status, text, answer = slave.requestTopic(CALLER, topic, [["TCPROS"]])
    if status != 1 or not answer:
        raise ConnectionError(f"{node} offers no {topic}: {text}")
    _, host, port = answer
    with socket.create_connection((host, port), TIMEOUT) as connection:
        _greet(connection, {"topic": topic, "type": kind._type, "md5sum": kind._md5sum, "callerid": CALLER})
        return kind().deserialize(_frame(connection))


def _greet(connection: socket.socket, header: dict[str, str]) -> None:
    rosgraph.network.write_ros_handshake_header(connection, header)
    _frame(connection)


def _frame(connection: socket.socket) -> bytes:
    return _read(connection, *struct.unpack("<I", _read(connection, 4)))


def _read(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        part = connection.recv(count - len(data))
        if not part:
            raise ConnectionError("the connection was closed")
        data += part
    return data
