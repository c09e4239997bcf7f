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


def call(master: rosgraph.Master, service: str, kind: Any, **fields: Any) -> Any:
    """Calls a service of type `kind` and returns its response."""
    request, response = BytesIO(), kind._response_class()
    kind._request_class(**fields).serialize(request)
    uri = master.lookupService(service).replace("rosrpc", "http")
    with socket.create_connection(rosgraph.network.parse_http_host_and_port(uri), TIMEOUT) as connection:
        _greet(connection, {"service": service, "md5sum": kind._md5sum, "callerid": CALLER})
        connection.sendall(struct.pack("<I", len(request.getvalue())) + request.getvalue())
        good, body = _read(connection, 1) == b"\x01", _frame(connection)
    if not good:
        raise OSError(f"{service}: {body.decode(errors='replace')}")
    response.deserialize(body)
    return response


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
