"""Asynchronous XML-RPC calls to masters and nodes."""

import ipaddress
import xmlrpc.client
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any
from urllib.parse import urlsplit

from tcpros.dialled_stream import DialledStream
from tcpros.error import TcprosError
from tcpros.http import NONSENSE, http_message, http_request, xmlrpc_values
from tcpros.reactor import Reactor
from tcpros.resolver import Resolver

MAX_PARALLEL = 4
"""Maximum number of concurrent calls to one server: a Python XML-RPC server queues five connections and drops more."""

MAX_ANSWER = 4 * 2**20
"""Maximum size of a response [bytes]. Only getParam needs that much; all others are short."""

_NOT_XMLRPC = (TypeError, ValueError, OverflowError, RecursionError)
"""Exceptions of values that XML-RPC cannot carry: large integers, invalid texts, deep nesting."""

Done = Callable[[Any], object]
Failed = Callable[[str], object]


def host_and_port(uri: str) -> tuple[str, int]:
    """Returns host and port of a URI; "" or 0 if it has none.

    rospy writes an IPv6 address without brackets: `http://::1:40000/`.
    """
    try:
        uri.encode()  # a request could not carry a URI with invalid characters
        parts = urlsplit(uri)
        host, _, port = parts.netloc.rpartition(":")
        if _is_ipv6(host):
            parts = urlsplit(f"//[{host}]:{port}")
        return parts.hostname or "", parts.port or 0
    except ValueError:
        return "", 0


def _is_ipv6(host: str) -> bool:
    try:
        ipaddress.IPv6Address(host)
    except ValueError:
        return False
    return True


class NoAnswer(str):
    """The reason why a call got no answer. The server may have executed it, and a retry may succeed."""


class _Call(DialledStream):
    """One call, on its own connection."""

    def __init__(
        self, reactor: Reactor, uri: str, body: bytes, answered: Callable[[bytes, str], None]
    ) -> None:
        parts = urlsplit(uri)
        super().__init__(reactor, uri, http_request(parts.netloc, parts.path, body))
        self.parse = self._response
        self._answered = answered
        self._body: bytes | None = None
        self._received = bytearray()

    def closed(self, reason: str) -> None:
        if self._body is None and not reason:
            message = http_message(self._received, -1, MAX_ANSWER)
            if message is not None and message.length < 0:
                self._body = bytes(self._received[message.start :])
        self._answered(self._body or b"", reason or "it closed the connection")

    def _response(self, data: memoryview) -> int:
        self._received += data
        message = http_message(self._received, -1, MAX_ANSWER)
        if message is not None and 0 <= message.length <= len(self._received) - message.start:
            self._body = bytes(self._received[message.start : message.end])
            self.close("")
        elif len(self._received) > MAX_ANSWER:
            raise TcprosError(f"its answer is longer than {MAX_ANSWER} bytes")
        return len(data)


class Server:
    """A client for one XML-RPC server; it makes a few calls at a time, in order."""

    def __init__(self, reactor: Reactor, resolver: Resolver, uri: str, timeout: float) -> None:
        self.uri = uri
        self._reactor = reactor
        self._resolver = resolver
        self._timeout = timeout
        self._queue: deque[tuple[bytes, Done, Failed]] = deque()
        self._running = 0

    def call(self, method: str, arguments: tuple[Any, ...], done: Done, failed: Failed) -> None:
        """Calls a method of the ROS master or slave API.

        Args:
            method: its name.
            arguments: the caller's name first.
            done: called with the value if the call returns status 1.
            failed: called with a sentence otherwise: a `NoAnswer` unless the server refused. Exactly one of the two is
                called, once, within the timeout.
        """
        try:
            body = xmlrpc.client.dumps(arguments, method).encode()
        except _NOT_XMLRPC as error:
            reason = f"{method} cannot be called with these values: {error}"
            self._reactor.call(lambda: failed(reason))
            return
        self._queue.append((body, done, failed))
        self._next()

    def _next(self) -> None:
        if self._queue and self._running < MAX_PARALLEL:
            self._running += 1
            body, done, failed = self._queue.popleft()
            self._dial(body, partial(self._answered, done, failed))

    def _dial(self, body: bytes, answered: Callable[[bytes, str], None]) -> None:
        """Sends one request; calls `answered` with the response's body, or with b"" and the reason."""
        host, port = host_and_port(self.uri)
        if not host or not port:
            answered(b"", f"{self.uri!r} is not an address")
            return

        def found(address: str) -> None:
            call = _Call(self._reactor, self.uri, body, answered)
            self._reactor.call_later(self._timeout, lambda: call.close("it did not answer in time"))
            call.connect(address, port)

        self._resolver.resolve(host, found, lambda reason: answered(b"", reason))

    def _answered(self, done: Done, failed: Failed, body: bytes, reason: str) -> None:
        self._running -= 1
        self._next()
        if not body:
            failed(NoAnswer(f"{self.uri}: {reason}"))
            return
        try:
            (answer,), _ = xmlrpc_values(body)
            status, text, value = answer
        except NONSENSE as error:
            failed(f"{self.uri} answered nonsense: {error}")
            return
        if status == 1:
            done(value)
        else:
            failed(str(text))
