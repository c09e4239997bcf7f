"""What our ROS master knows: who publishes, subscribes and serves what, without ourselves and without proxies."""

import contextlib
import http.client
import socket
import urllib.parse
import xmlrpc.client
from typing import Any

from rocon_gateway.core.error import GatewayError
from rocon_hub_protocol.core.rule import Connection, Kind
from rocon_relay.core.connection import ANY, is_proxy_uri
from tcpros.core.http import NONSENSE

TIMEOUT = 3.0
"""Within which the master must have answered [s]."""

_Row = tuple[Kind, str, list[str]]


class MasterError(GatewayError):
    """The master does not answer, or answers nonsense."""


class _UnknownError(MasterError):
    """The master says that it knows no such thing."""


class MasterWatch:
    """Looks at a master over one kept connection; cheap as long as nothing changes. One thread only.

    Args:
        uri: the master's.
        node: our own node's name, whose connections never count.

    Attributes:
        knows_us: whether the master named a service of ours at the last look; one that was restarted does not.
    """

    def __init__(self, uri: str, node: str) -> None:
        parts = urllib.parse.urlsplit(uri)
        self._line = _Line(parts.hostname or "localhost", parts.port or 11311, parts.netloc)
        self._node = node
        self._state_request = _request("getSystemState", node)
        self._types_request = _request("getTopicTypes", node)
        self._seen: bytes | None = None
        self._types_due = False
        self.knows_us = False
        self._local: frozenset[Connection] = frozenset()
        self._proxies: dict[str, bool] = {}

    def changed(self) -> bool:
        """Asks the master; tells whether its answer differs from the last one.

        Raises:
            MasterError: it does not answer, or nonsense. It will count as changed when it answers again.
        """
        try:
            state = self._post(self._state_request)
            if state == self._seen and not self._types_due:
                return False
            rows = _rows(_value(state))
            local = self._connections(rows, _types(_value(self._post(self._types_request))))
        except MasterError:
            self._seen = None
            raise
        is_new = (state, local) != (self._seen, self._local)
        self.knows_us = any(kind == Kind.SERVICE and self._node in nodes for kind, _, nodes in rows)
        self._seen, self._local, self._types_due = state, local, False
        return is_new

    def read_types(self) -> None:
        """Has the next look read the topics' types, even if nobody has come or gone.

        A node that was killed and came back with another type leaves the master's state as it was.
        """
        self._types_due = True

    @property
    def local(self) -> frozenset[Connection]:
        """Publishers, subscribers and services at the last look; of what type a service is, no master knows."""
        return self._local

    def close(self) -> None:
        """Closes the connection."""
        self._line.close()

    def _connections(self, rows: list[_Row], types: dict[str, str]) -> frozenset[Connection]:
        nodes = {node for _, _, names in rows for node in names}
        self._proxies = {node: proxy for node, proxy in self._proxies.items() if node in nodes}
        return frozenset(
            Connection(kind, name, ANY if kind == Kind.SERVICE else types.get(name, ANY), node)
            for kind, name, names in rows
            for node in names
            if node != self._node and not self._is_proxy(node)
        )

    def _is_proxy(self, node: str) -> bool:
        """Tells whether some gateway made up this node; asked once as long as the node has any connection."""
        if node not in self._proxies:
            try:
                self._proxies[node] = is_proxy_uri(str(_value(self._post(_request("lookupNode", self._node, node)))))
            except _UnknownError:
                # Gone between two calls: the next look will show that.
                return True
        return self._proxies[node]

    def _post(self, body: bytes) -> bytes:
        try:
            return self._line.ask(body)
        except (http.client.HTTPException, OSError):
            # A kept connection that the master has closed; a new one tells whether the master lives.
            self._line.close()
        try:
            return self._line.ask(body)
        except (http.client.HTTPException, OSError) as error:
            self._line.close()
            raise MasterError(f"the ROS master does not answer: {error}") from None


class _Line:
    """A kept connection to a master. What http.client builds each time and sends in two packets goes in one, prepared:
    that is half of what a look costs, here and at the master.
    """

    def __init__(self, host: str, port: int, name: str) -> None:
        self._address = host, port
        self._head = f"POST /RPC2 HTTP/1.1\r\nHost: {name}\r\nContent-Type: text/xml\r\nContent-Length: ".encode()
        self._socket: socket.socket | None = None

    def ask(self, body: bytes) -> bytes:
        """Returns the answer. Raises MasterError for an error's, HTTPException for what is none, OSError for none."""
        if self._socket is None:
            self._socket = socket.create_connection(self._address, TIMEOUT)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.sendall(b"%b%d\r\n\r\n%b" % (self._head, len(body), body))
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


def _request(method: str, *arguments: str) -> bytes:
    return xmlrpc.client.dumps(arguments, method).encode()


def _value(answer: bytes) -> Any:
    """Returns the third part of a master's answer. Raises MasterError, of a kind of its own if the master says no."""
    try:
        ((code, message, value),) = xmlrpc.client.loads(answer)[0]  # type: ignore[arg-type]
    except xmlrpc.client.Fault as error:
        raise MasterError(f"the ROS master fails: {error.faultString}") from None
    except NONSENSE as error:
        raise MasterError(f"the ROS master's answer is none: {error}") from None
    if code != 1:
        raise _UnknownError(f"the ROS master says no: {message!s}")
    return value


def _rows(state: Any) -> list[_Row]:
    """Returns kind, name and nodes of everything in a master's system state. Raises MasterError."""
    try:
        publishers, subscribers, services = state
        parts = (Kind.PUBLISHER, publishers), (Kind.SUBSCRIBER, subscribers), (Kind.SERVICE, services)
        rows = [(kind, name, nodes) for kind, part in parts for name, nodes in part]
    except (ValueError, TypeError) as error:
        raise MasterError(f"the ROS master tells no system state: {error}") from None
    if not all(isinstance(nodes, list) and _are_texts(name, *nodes) for _, name, nodes in rows):
        raise MasterError("the ROS master tells a system state in which names are none")
    return rows


def _types(told: Any) -> dict[str, str]:
    """Returns the type of each topic. Raises MasterError."""
    try:
        types = dict(told)
    except (ValueError, TypeError) as error:
        raise MasterError(f"the ROS master tells no topic types: {error}") from None
    if not _are_texts(*types, *types.values()):
        raise MasterError("the ROS master tells topic types that are none")
    return types


def _are_texts(*values: object) -> bool:
    return all(isinstance(one, str) for one in values)
