"""State shared by the nodes of one process."""

import logging

from tcpros.adapters.reactor import Reactor
from tcpros.adapters.resolver import Resolver
from tcpros.adapters.xmlrpc_client import Server

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
    """

    def __init__(self, reactor: Reactor, master_uri: str, host: str, bind: str, logger: logging.Logger) -> None:
        self.reactor, self.resolver = reactor, Resolver(reactor)
        self.master_uri, self.host, self.bind, self.logger = master_uri, host, bind, logger
        self.master = self.server(master_uri)

    def server(self, uri: str) -> Server:
        """Returns a client for the XML-RPC server of a node or master."""
        return Server(self.reactor, self.resolver, uri, PATIENCE)
