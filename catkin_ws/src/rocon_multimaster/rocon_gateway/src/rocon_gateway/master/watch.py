"""Reads from our ROS master which nodes publish, subscribe and serve what, excluding ourselves and proxies."""

import http.client
from collections.abc import Collection, Iterable
from typing import Any

from rocon_gateway.master.line import MasterError, MasterLine, UnknownError, request, value
from rocon_hub_protocol.rule import Connection, Kind
from rocon_relay.connection import ANY, is_proxy_uri

_Row = tuple[Kind, str, list[str]]


class MasterWatch:
    """Polls a master over one persistent connection; cheap as long as nothing changes. For one thread only.

    Args:
        uri: URI of the master.
        node: our own node's name; its connections are ignored.
        own: topics of our node that are not ignored.
    """

    def __init__(self, uri: str, node: str, own: Collection[str] = ()) -> None:
        self._line = MasterLine(uri)
        self._node, self._own = node, own
        self._state_request = request("getSystemState", node)
        self._types_request = request("getTopicTypes", node)
        self._seen: bytes | None = None
        self._types_due = False
        #: whether the master listed a service of ours at the last poll; a restarted master does not
        self.knows_us = False
        self._local: frozenset[Connection] = frozenset()
        self._proxies: dict[str, bool] = {}

    def changed(self) -> bool:
        """Polls the master; returns whether its state has changed.

        Raises:
            MasterError: it does not answer, or its answer is invalid. Its next answer counts as changed.
        """
        try:
            state = self._post(self._state_request)
            if state == self._seen and not self._types_due:
                return False
            rows = system_rows(value(state))
            local = self._connections(rows, _types(value(self._post(self._types_request))))
        except MasterError:
            self._seen = None
            raise
        is_new = (state, local) != (self._seen, self._local)
        self.knows_us = any(kind == Kind.SERVICE and self._node in nodes for kind, _, nodes in rows)
        self._seen, self._local, self._types_due = state, local, False
        return is_new

    def read_types(self) -> None:
        """Makes the next poll read the topic types even if the registrations have not changed.

        A node that was killed and restarted with another type does not change the master's state.
        """
        self._types_due = True

    def look_up_again(self, nodes: Iterable[str]) -> None:
        """Makes the next poll check again whether these nodes are proxies."""
        for node in nodes:
            self._proxies.pop(node, None)
        self._types_due = True

    @property
    def local(self) -> frozenset[Connection]:
        """Publishers, subscribers and services at the last poll; a master does not know the types of services."""
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
            if (node != self._node or name in self._own) and not self._is_proxy(node)
        )

    def _is_proxy(self, node: str) -> bool:
        """Returns whether a node is a gateway's proxy; cached as long as the node has any connection."""
        if node not in self._proxies:
            try:
                self._proxies[node] = is_proxy_uri(
                    str(value(self._post(request("lookupNode", self._node, node))))
                )
            except UnknownError:
                # The node has disappeared between two calls; the next poll will show it.
                return True
        return self._proxies[node]

    def _post(self, body: bytes) -> bytes:
        try:
            return self._line.ask(body)
        except (http.client.HTTPException, OSError):
            # The master may have closed the persistent connection; a new one shows whether it is alive.
            self._line.close()
        try:
            return self._line.ask(body)
        except (http.client.HTTPException, OSError) as error:
            self._line.close()
            raise MasterError(f"the ROS master does not answer: {error}") from None


def system_rows(state: Any) -> list[_Row]:
    """Returns kind, name and nodes of each entry in a master's system state. Raises MasterError."""
    try:
        publishers, subscribers, services = state
        parts = (
            (Kind.PUBLISHER, publishers),
            (Kind.SUBSCRIBER, subscribers),
            (Kind.SERVICE, services),
        )
        rows = [(kind, name, nodes) for kind, part in parts for name, nodes in part]
    except (ValueError, TypeError) as error:
        raise MasterError(f"invalid system state from the ROS master: {error}") from None
    if not all(isinstance(nodes, list) and _are_texts(name, *nodes) for _, name, nodes in rows):
        raise MasterError("invalid names in the ROS master's system state")
    return rows


def _types(told: Any) -> dict[str, str]:
    """Returns the type of each topic. Raises MasterError."""
    try:
        types = dict(told)
    except (ValueError, TypeError) as error:
        raise MasterError(f"the ROS master tells no topic types: {error}") from None
    if not _are_texts(*types, *types.values()):
        raise MasterError("invalid topic types from the ROS master")
    return types


def _are_texts(*values: object) -> bool:
    return all(isinstance(one, str) for one in values)
