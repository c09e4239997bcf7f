"""A persistent XML-RPC connection to a ROS master."""

import contextlib
import http.client
import socket
import urllib.parse
import xmlrpc.client
from typing import Any

from rocon_gateway.error import GatewayError
from tcpros.http import NONSENSE

TIMEOUT = 3.0
"""Timeout for the master's answer [s]."""


class MasterError(GatewayError):
    """The master does not answer, or its answer is invalid."""


class UnknownError(MasterError):
    """The master reports that the requested name is unknown."""


class MasterLine:
    """A connection that sends each call with a prepared head in one packet. For one thread only.

    http.client builds the head each time and sends two packets; avoiding that halves the cost of a poll, here and at
    the master.

    Args:
        uri: URI of the master.
    """

    def __init__(self, uri: str) -> None:
        parts = urllib.parse.urlsplit(uri)
        self._address = parts.hostname or "localhost", parts.port or 11311
        fields = f"Host: {parts.netloc}\r\nContent-Type: text/xml\r\nContent-Length: "
        self._head = f"POST /RPC2 HTTP/1.1\r\n{fields}".encode()
        self._socket: socket.socket | None = None

    @property
    def descriptors(self) -> list[int]:
        """The connection's file descriptor; empty without a connection."""
        return [self._socket.fileno()] if self._socket else []

    def ask(self, body: bytes) -> bytes:
        """Sends a call and returns the body of the answer.

        Raises:
            MasterError: the answer has an error status.
            HTTPException: the answer is not HTTP.
            OSError: there is no answer.
        """
        self.send(body)
        return self.read()

    def send(self, body: bytes) -> None:
        """Sends a call without waiting for the answer. Raises OSError."""
        if self._socket is None:
            self._socket = socket.create_connection(self._address, TIMEOUT)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.sendall(b"%b%d\r\n\r\n%b" % (self._head, len(body), body))

    def read(self) -> bytes:
        """Reads the answer to the last call. Raises the same errors as `ask`."""
        if self._socket is None:
            raise ConnectionError("nothing was asked")
        with contextlib.closing(http.client.HTTPResponse(self._socket, method="POST")) as response:
            response.begin()
            answer = response.read()
            if response.will_close:
                self.close()
            if response.status != http.client.OK:
                raise MasterError(
                    f"the ROS master answers with the error {response.status} {response.reason}"
                )
        return answer

    def close(self) -> None:
        """Closes the connection; the next call opens a new one."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def request(method: str, *arguments: str | int | float) -> bytes:
    """Returns the body of a call."""
    return xmlrpc.client.dumps(arguments, method).encode()


def value(answer: bytes) -> Any:
    """Returns the value in a master's answer. Raises MasterError, or UnknownError if the status is not success."""
    try:
        ((code, message, found),) = xmlrpc.client.loads(answer)[0]  # type: ignore[arg-type]
    except xmlrpc.client.Fault as error:
        raise MasterError(f"the ROS master fails: {error.faultString}") from None
    except NONSENSE as error:
        raise MasterError(f"invalid response from the ROS master: {error}") from None
    if code != 1:
        raise UnknownError(f"the ROS master returned an error: {message!s}")
    return found
