"""The subset of HTTP/1.1 that XML-RPC between ROS nodes and masters needs, working on bytes."""

import xmlrpc.client
from dataclasses import dataclass
from typing import Any
from xml.parsers.expat import ExpatError

from tcpros.error import TcprosError

MAX_HEAD = 16 * 1024
MAX_BODY = 2**20
"""Maximum size of a request's body [bytes]: a list of 10,000 publishers."""

NONSENSE = (
    xmlrpc.client.Error,
    ExpatError,
    ValueError,
    TypeError,
    LookupError,
    ArithmeticError,
    AttributeError,
)
"""Exceptions raised when parsing invalid XML-RPC, or when unpacking a response of an unexpected form."""


class _Parser(xmlrpc.client.ExpatParser):
    """Refuses documents that declare a type: XML-RPC has none, and entities declared there expand to gigabytes."""

    def __init__(self, target: xmlrpc.client.Unmarshaller) -> None:
        super().__init__(target)
        self._parser.StartDoctypeDeclHandler = _refuse_doctype  # type: ignore[attr-defined]


def _refuse_doctype(*_: object) -> None:
    raise ValueError("a document type")


def xmlrpc_values(body: bytes) -> tuple[tuple[Any, ...], str | None]:
    """Returns the values of an XML-RPC request or response, and the method's name; raises one of `NONSENSE`."""
    unmarshaller = xmlrpc.client.Unmarshaller()
    parser = _Parser(unmarshaller)
    parser.feed(body)
    parser.close()
    return unmarshaller.close(), unmarshaller.getmethodname()


class HttpError(TcprosError):
    """The data is not HTTP, or is too long."""


@dataclass(frozen=True, slots=True)
class HttpMessage:
    """A request or a response."""

    first: str  #: its first line
    length: int  #: size of the body [bytes]; -1 if it ends with the connection
    start: int  #: where the body begins
    keep_alive: bool  #: whether the sender wants to keep the connection

    @property
    def end(self) -> int:
        """Where the body ends; meaningless if `length` is -1."""
        return self.start + self.length


def http_message(
    data: bytes | bytearray | memoryview, default_length: int, max_body: int = MAX_BODY
) -> HttpMessage | None:
    """Parses the head of a message; returns None while it is incomplete.

    Args:
        data: the data received so far.
        default_length: length of the body if the head does not give it.
        max_body: maximum size of the body [bytes].

    Raises:
        HttpError: the data is not HTTP, is longer than `MAX_HEAD` and `max_body` allow, or is chunked.
    """
    text = bytes(data[: MAX_HEAD + 4])
    end = text.find(b"\r\n\r\n")
    if end < 0:
        if len(data) > MAX_HEAD:
            raise HttpError(f"an HTTP head longer than {MAX_HEAD} bytes")
        return None
    first, *lines = text[:end].decode("latin-1").split("\r\n")
    if "HTTP/1." not in first:
        raise HttpError("not HTTP/1")
    fields = {
        key.strip().lower(): value.strip()
        for key, _, value in (line.partition(":") for line in lines)
    }
    if "transfer-encoding" in fields:
        raise HttpError("chunked HTTP is not supported")
    connection = fields.get("connection", "close" if "HTTP/1.0" in first else "keep-alive").lower()
    return HttpMessage(
        first, _length(fields, default_length, max_body), end + 4, connection != "close"
    )


def _length(fields: dict[str, str], default: int, most: int) -> int:
    text = fields.get("content-length")
    if text is None:
        return default
    if not (text.isascii() and text.isdigit()) or len(text) > 9 or int(text) > most:
        raise HttpError(f"an HTTP body of {text[:20]!r} bytes; {most} are allowed")
    return int(text)


def http_request(host: str, path: str, body: bytes) -> bytes:
    """Returns an XML-RPC request that asks the server to close the connection after the response."""
    head = (
        f"POST {path or '/'} HTTP/1.1\r\nHost: {host}\r\nUser-Agent: tcpros\r\nContent-Type: text/xml\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    )
    return head.encode() + body


def http_response(body: bytes, keep_alive: bool, status: str = "200 OK") -> bytes:
    """Returns an XML-RPC response."""
    connection = "keep-alive" if keep_alive else "close"
    head = (
        f"HTTP/1.1 {status}\r\nServer: tcpros\r\nContent-Type: text/xml\r\n"
        f"Content-Length: {len(body)}\r\nConnection: {connection}\r\n\r\n"
    )
    return head.encode() + body
