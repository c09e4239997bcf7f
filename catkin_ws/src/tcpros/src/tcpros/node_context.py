"""State shared by the nodes of one process."""

import logging

from tcpros.reactor import Reactor
from tcpros.resolver import Resolver
from tcpros.xmlrpc_client import Server

PATIENCE = 5.0
"""Timeout for a connection header to arrive, and for a master or node to answer a call [s]."""


class NodeContext:
    """The event loop, the master and the network address shared by these nodes.

    Args:
        reactor: the loop.
        master_uri: the master of all nodes.
        host: name or address under which others reach this machine.
        bind: the local address to listen on; "" for all.
        logger: receives connection problems.
        header_timeout: timeout for a connection header to arrive [s]; None for `PATIENCE`.
        call_timeout: timeout for a master or node to answer a call [s]; None for `PATIENCE`.
    """

    def __init__(
        self,
        reactor: Reactor,
        master_uri: str,
        host: str,
        bind: str,
        logger: logging.Logger,
        header_timeout: float | None = None,
        call_timeout: float | None = None,
    ) -> None:
        self.reactor, self.resolver = reactor, Resolver(reactor)
        self.master_uri, self.host, self.bind, self.logger = master_uri, host, bind, logger
        self.header_timeout = PATIENCE if header_timeout is None else header_timeout
        self._call_timeout = PATIENCE if call_timeout is None else call_timeout
        self.master = self.server(master_uri)

    def server(self, uri: str) -> Server:
        """Returns a client for the XML-RPC server of a node or master."""
        return Server(self.reactor, self.resolver, uri, self._call_timeout)


class Pause:
    """Exponential back-off: each pause between attempts is twice as long as the one before.

    Args:
        shortest: the first pause [s].
        longest: the longest pause [s].
    """

    def __init__(self, shortest: float = 0.1, longest: float = 2.0) -> None:
        self._shortest, self._longest = shortest, longest
        self._next = shortest

    def take(self) -> float:
        """Returns how long to wait now [s]."""
        pause, self._next = self._next, min(2 * self._next, self._longest)
        return pause

    def reset(self) -> None:
        """Starts again with the shortest pause."""
        self._next = self._shortest
