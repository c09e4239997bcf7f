"""A blocking client of the services and topics of any master, for programs that are not ROS nodes themselves.

Network errors are OSErrors. The classes of services and messages are those that ROS generates; they are only used
through their methods, so this module imports no ROS package.
"""

import contextlib
import socket
import struct
import xmlrpc.client
from io import BytesIO
from typing import Any
from urllib.parse import urlsplit

from tcpros.core.error import TcprosError
from tcpros.core.header import header_bytes, header_fields

TIMEOUT = 10.0
"""For connecting and for each answer [s]."""


class ClientError(TcprosError):
    """The master, node or server returned an error."""


class Connection:
    """A connection to a server or publisher after the exchange of headers.

    Args:
        host: the other end.
        port: its port.
        header: our connection header.

    Raises:
        ClientError: the other end refuses the header.
    """

    def __init__(self, host: str, port: int, header: dict[str, str]) -> None:
        self._socket = socket.create_connection((host, port), TIMEOUT)
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket.sendall(header_bytes(header))
            self.header = header_fields(self.read_frame())  #: the other end's
            if "error" in self.header:
                raise ClientError(self.header["error"])
        except BaseException:
            self._socket.close()
            raise

    def __enter__(self) -> "Connection":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def be_patient(self) -> None:
        """Waits for further frames without limit: a publisher may be silent; `interrupt` ends that."""
        self._socket.settimeout(None)

    def interrupt(self) -> None:
        """Ends a `read_frame` of another thread, by a ConnectionError there."""
        with contextlib.suppress(OSError):  # it is closed already
            self._socket.shutdown(socket.SHUT_RDWR)

    def call_raw(self, body: bytes) -> bytes:
        """Calls the service at the other end with a serialized request; returns the serialized response.

        Raises:
            ClientError: the call failed in the server.
        """
        self._socket.sendall(struct.pack("<I", len(body)) + body)
        succeeded = self._read(1) == b"\x01"
        answer = self.read_frame()
        if not succeeded:
            raise ClientError(answer.decode(errors="replace"))
        return answer

    def call(self, kind: Any, **fields: Any) -> Any:
        """Calls the service of type `kind` at the other end; returns its response.

        Raises:
            ClientError: the call failed in the server.
        """
        body = BytesIO()
        kind._request_class(**fields).serialize(body)
        return kind._response_class().deserialize(self.call_raw(body.getvalue()))

    def read_frame(self) -> bytes:
        """Returns the next message, or header, without its length."""
        return self._read(*struct.unpack("<I", self._read(4)))

    def _read(self, count: int) -> bytes:
        data = bytearray()
        while len(data) < count:
            part = self._socket.recv(min(65536, count - len(data)))
            if not part:
                raise ConnectionError("the connection was closed")
            data += part
        return bytes(data)


class Client:
    """Services and topics of one master.

    Args:
        master_uri: the master.
        name: the node name under which the other ends see us.
    """

    def __init__(self, master_uri: str, name: str) -> None:
        self._master_uri = master_uri
        self._name = name

    def ask_master(self, method: str, *arguments: Any) -> Any:
        """Returns the value of a call of the master's API. Raises ClientError if the master returns an error."""
        return self._ask(self._master_uri, method, *arguments)

    def service(self, name: str, md5sum: str, **header: str) -> Connection:
        """Returns a connection to a service: for one call, or any number with `persistent="1"` in the header."""
        address = urlsplit(self.ask_master("lookupService", name))
        if not address.hostname or not address.port:
            raise ClientError(f"{name} has the invalid address {address.geturl()!r}")
        fields = {"service": name, "md5sum": md5sum, "callerid": self._name, **header}
        return Connection(address.hostname, address.port, fields)

    def call(self, service: str, kind: Any, **fields: Any) -> Any:
        """Calls a service of type `kind` once; returns its response."""
        with self.service(service, kind._md5sum) as connection:
            return connection.call(kind, **fields)

    def subscribe(self, node: str, topic: str, type_: str = "*", md5sum: str = "*") -> Connection:
        """Returns a connection on which the messages of one publisher arrive; the master does not learn of it."""
        uri = self.ask_master("lookupNode", node)
        answer = self._ask(uri, "requestTopic", topic, [["TCPROS"]])
        if not isinstance(answer, list) or len(answer) < 3:
            raise ClientError(f"{node} does not publish {topic}")
        header = {"topic": topic, "type": type_, "md5sum": md5sum, "callerid": self._name}
        return Connection(str(answer[1]), int(answer[2]), header)

    def latched(self, node: str, topic: str, kind: Any) -> Any:
        """Returns the message of type `kind` that a publisher keeps for new subscribers."""
        with self.subscribe(node, topic, kind._type, kind._md5sum) as connection:
            return kind().deserialize(connection.read_frame())

    def _ask(self, uri: str, method: str, *arguments: Any) -> Any:
        try:
            with xmlrpc.client.ServerProxy(uri) as server:
                status, message, value = getattr(server, method)(self._name, *arguments)
        except (xmlrpc.client.Error, ValueError, TypeError) as error:
            raise ClientError(f"{uri}: {error}") from None
        if status != 1:
            raise ClientError(str(message))
        return value
