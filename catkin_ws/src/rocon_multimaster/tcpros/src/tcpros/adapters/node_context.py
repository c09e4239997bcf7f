"""What the nodes of one process share."""

import logging

from tcpros.adapters.reactor import Reactor
from tcpros.adapters.resolver import Resolver
from tcpros.adapters.xmlrpc_client import Server

PATIENCE = 5.0
"""Within which a connection must have introduced itself, and a master or node answered a call [s]."""


class NodeContext:
    """The loop, the master, and where this machine is.

    Args:
        reactor: the loop.
        master_uri: the master of all nodes.
        host: name or address of this machine, for others.
        bind: the local address to listen on; "" for all.
        logger: for what is wrong with connections.
    """

    def __init__(self, reactor: Reactor, master_uri: str, host: str, bind: str, logger: logging.Logger) -> None:
        self.reactor, self.resolver = reactor, Resolver(reactor)
        self.master_uri, self.host, self.bind, self.logger = master_uri, host, bind, logger
        self.master = self.server(master_uri)

    def server(self, uri: str) -> Server:
        """Returns a client of a node's or master's XML-RPC server."""
        return Server(self.reactor, self.resolver, uri, PATIENCE)
