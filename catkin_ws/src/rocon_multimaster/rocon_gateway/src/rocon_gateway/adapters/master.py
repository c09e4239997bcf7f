"""What our ROS master knows: who publishes, subscribes and serves what, without ourselves and without proxies."""

import http.client
import urllib.parse
import xmlrpc.client
from typing import Any

from rocon_gateway.core.code import GatewayError
from rocon_gateway.core.connection import ANY, is_proxy_uri
from rocon_gateway.core.rule import Connection, Kind

TIMEOUT = 3.0
"""Within which the master must have answered [s]."""


class MasterError(GatewayError):
    """The master does not answer, or answers nonsense."""


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
        self._http = http.client.HTTPConnection(parts.hostname or "localhost", parts.port or 11311, timeout=TIMEOUT)
        self._node = node
        self._state_request = _request("getSystemState", node)
        self._types_request = _request("getTopicTypes", node)
        self._seen = b""
        self.knows_us = False
        self._local: frozenset[Connection] = frozenset()
        self._proxies: dict[str, bool] = {}

    def changed(self) -> bool:
        """Asks the master; tells whether its answer differs from the last one.

        Raises:
            MasterError: it does not answer. It will count as changed when it answers again.
        """
        state = self._post(self._state_request)
        if state == self._seen:
            return False
        publishers, subscribers, services = _value(state)
        self.knows_us = any(self._node in nodes for _, nodes in services)
        rows = [
            (kind, *row)
            for kind, part in ((Kind.PUBLISHER, publishers), (Kind.SUBSCRIBER, subscribers), (Kind.SERVICE, services))
            for row in part
        ]
        self._local = self._connections(rows, dict(_value(self._post(self._types_request))))
        self._seen = state
        return True

    @property
    def local(self) -> frozenset[Connection]:
        """Publishers, subscribers and services at the last look; of what type a service is, no master knows."""
        return self._local

    def close(self) -> None:
        """Closes the connection."""
        self._http.close()

    def _connections(self, rows: list[Any], types: dict[str, str]) -> frozenset[Connection]:
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
            except xmlrpc.client.Fault as error:
                raise MasterError(f"the master fails: {error.faultString}") from None
            except LookupError:
                # Gone between two calls: the next look will show that.
                return True
        return self._proxies[node]

    def _post(self, body: bytes) -> bytes:
        try:
            return self._send(body)
        except (http.client.HTTPException, OSError):
            # A kept connection that the master has closed; a new one tells whether the master lives.
            self._http.close()
        try:
            return self._send(body)
        except (http.client.HTTPException, OSError) as error:
            self._http.close()
            self._seen = b""
            raise MasterError(f"the ROS master does not answer: {error}") from None

    def _send(self, body: bytes) -> bytes:
        self._http.request("POST", "/RPC2", body, {"Content-Type": "text/xml"})
        return self._http.getresponse().read()


def _request(method: str, *arguments: str) -> bytes:
    return xmlrpc.client.dumps(arguments, method).encode()


def _value(answer: bytes) -> Any:
    """Returns the third part of a master's answer. Raises LookupError where the master says it knows no such thing."""
    try:
        ((code, message, value),) = xmlrpc.client.loads(answer)[0]
    except (ValueError, TypeError, xmlrpc.client.ResponseError) as error:
        raise MasterError(f"the ROS master's answer is none: {error}") from None
    if code != 1:
        raise LookupError(message)
    return value
