"""A kept connection to a ROS master, and what is said on it."""

import contextlib
import http.client
import socket
import urllib.parse
import xmlrpc.client
from typing import Any

from rocon_gateway.core.error import GatewayError
from tcpros.core.http import NONSENSE

TIMEOUT = 3.0
"""Within which the master must have answered [s]."""


class MasterError(GatewayError):
    """The master does not answer, or answers nonsense."""


class UnknownError(MasterError):
    """The master says that it knows no such thing."""


class MasterLine:
    """What http.client builds each time and sends in two packets goes in one, prepared: that is half of what a look
    costs, here and at the master. One thread only.

    Args:
        uri: the master's.
    """

    def __init__(self, uri: str) -> None:
        parts = urllib.parse.urlsplit(uri)
        self._address = parts.hostname or "localhost", parts.port or 11311
        self._head = (
            f"POST /RPC2 HTTP/1.1\r\nHost: {parts.netloc}\r\nContent-Type: text/xml\r\nContent-Length: ".encode()
        )
        self._socket: socket.socket | None = None

    @property
    def descriptors(self) -> list[int]:
        """The connection's file descriptor, none without a connection."""
        return [self._socket.fileno()] if self._socket else []

    def ask(self, body: bytes) -> bytes:
        """Returns the answer.

        Raises:
            MasterError: it is an error's.
            HTTPException: it is none.
            OSError: there is none.
        """
        self.send(body)
        return self.read()

    def send(self, body: bytes) -> None:
        """Asks, without waiting for the answer. Raises OSError."""
        if self._socket is None:
            self._socket = socket.create_connection(self._address, TIMEOUT)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.sendall(b"%b%d\r\n\r\n%b" % (self._head, len(body), body))

    def read(self) -> bytes:
        """Returns the answer to what was sent. Raises as `ask` does."""
        if self._socket is None:
            raise ConnectionError("nothing was asked")
        with contextlib.closing(http.client.HTTPResponse(self._socket, method="POST")) as response:
            response.begin()
            answer = response.read()
            if response.will_close:
                self.close()
            if response.status != http.client.OK:
                raise MasterError(f"the ROS master answers with the error {response.status} {response.reason}")
        return answer

    def close(self) -> None:
        """Closes the connection; the next question makes a new one."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def request(method: str, *arguments: str | int | float) -> bytes:
    """Returns a call's body."""
    return xmlrpc.client.dumps(arguments, method).encode()


def value(answer: bytes) -> Any:
    """Returns the third part of a master's answer. Raises MasterError, UnknownError if the master says no."""
    try:
        ((code, message, found),) = xmlrpc.client.loads(answer)[0]  # type: ignore[arg-type]
    except xmlrpc.client.Fault as error:
        raise MasterError(f"the ROS master fails: {error.faultString}") from None
    except NONSENSE as error:
        raise MasterError(f"the ROS master's answer is none: {error}") from None
    if code != 1:
        raise UnknownError(f"the ROS master says no: {message!s}")
    return found
