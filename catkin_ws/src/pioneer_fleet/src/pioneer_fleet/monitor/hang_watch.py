"""Finds masters and nodes that run but do not answer, such as stopped ones, or ones in an endless loop."""

import logging
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from tcpros.reactor import Reactor
from tcpros.resolver import Resolver
from tcpros.xmlrpc_client import Server

PERIOD = 1.25
"""Time between two questions to a master or node [s]."""
PATIENCE = 3.0
"""Time-out for its answer [s]; with the pause before the question at most 5 s."""
MOST_ENDED = 1024
"""Maximum number of nodes that have ended and are remembered."""
PROXY_PATH = "/relayed/"
"""Path in the URI of a gateway's proxy for a node of another master, see `docs/gateway.md`."""
_TIMED_OUT = "did not answer in time"
_CALLER = "/pioneer_fleet"


@dataclass
class _Watched:
    """A master or node that is asked for its process id."""

    label: str  #: its name in messages
    server: Server
    answered: float  #: when it last answered [monotonic s]
    hangs: bool = False


class HangWatch:
    """Asks all masters and nodes for their process id, in a thread of its own.

    Args:
        masters: NAME=URI of each master.
    """

    def __init__(self, masters: Sequence[str]) -> None:
        self._reactor = Reactor(logging.getLogger(__name__))
        self._resolver = Resolver(self._reactor)
        self._lock = threading.Lock()
        self._news: list[str] = []
        self._watched: dict[str, _Watched] = {}
        self._ended: dict[str, None] = {}
        for named in masters:
            name, _, uri = named.partition("=")
            self._reactor.call(partial(self._watch_master, name, uri))
        self._thread = threading.Thread(target=self._reactor.run, name="hang watch", daemon=True)
        self._thread.start()

    def news(self) -> list[str]:
        """Returns a line for each master or node that has begun, or ceased, to hang since the last call."""
        with self._lock:
            news, self._news = self._news, []
            return news

    def faults(self) -> list[str]:
        """Returns a line for each master or node that hangs."""
        now = time.monotonic()
        with self._lock:
            return [
                f"{watched.label} has not answered for {now - watched.answered:.0f} s"
                for watched in self._watched.values()
                if watched.hangs
            ]

    def close(self) -> None:
        """Ends the thread."""
        self._reactor.call(self._reactor.stop)
        self._thread.join()

    def _watch_master(self, name: str, uri: str) -> None:
        self._watch(f"the ROS master of {name}", uri)
        self._list_nodes(name, Server(self._reactor, self._resolver, uri, PATIENCE))

    def _watch(self, label: str, uri: str) -> None:
        server = Server(self._reactor, self._resolver, uri, PATIENCE)
        watched = _Watched(label, server, time.monotonic())
        with self._lock:
            self._watched[uri] = watched
        self._ask(uri, watched)

    def _ask(self, uri: str, watched: _Watched) -> None:
        if self._watched.get(uri) is watched:
            watched.server.call(
                "getPid",
                (_CALLER,),
                lambda _pid: self._answered(uri, watched),
                lambda reason: self._failed(uri, watched, reason),
            )

    def _answered(self, uri: str, watched: _Watched) -> None:
        with self._lock:
            if watched.hangs:
                self._news.append(f"{watched.label} answers again")
            watched.hangs = False
            watched.answered = time.monotonic()
        self._reactor.call_later(PERIOD, partial(self._ask, uri, watched))

    def _failed(self, uri: str, watched: _Watched, reason: str) -> None:
        """Reports a time-out. A node that refuses the connection has ended, which is reported elsewhere."""
        is_master = watched.label.startswith("the ROS master")
        with self._lock:
            if _TIMED_OUT in reason:
                if not watched.hangs:
                    silence = time.monotonic() - watched.answered
                    self._news.append(
                        f"{watched.label} has not answered for {silence:.0f} s: it hangs or is stopped"
                    )
                watched.hangs = True
            elif is_master:
                watched.hangs = False
                watched.answered = time.monotonic()
            else:
                self._forget(uri)
        self._reactor.call_later(PERIOD, partial(self._ask, uri, watched))

    def _forget(self, uri: str) -> None:
        """Asks a node no more. If it was killed, its master still lists it."""
        del self._watched[uri]
        self._ended[uri] = None
        if len(self._ended) > MOST_ENDED:
            del self._ended[next(iter(self._ended))]

    def _list_nodes(self, name: str, master: Server) -> None:
        """Looks for new nodes at a master."""
        again = partial(self._reactor.call_later, PERIOD, partial(self._list_nodes, name, master))

        def listed(state: Any) -> None:
            nodes = {node for part in state for _, names in part for node in names}
            for node in nodes:
                master.call("lookupNode", (_CALLER, node), partial(found, node), lambda _: None)
            again()

        def found(node: str, uri: Any) -> None:
            # Proxies of other masters' nodes are parts of the gateway.
            is_node = isinstance(uri, str) and PROXY_PATH not in uri
            if is_node and uri not in self._watched and uri not in self._ended:
                self._watch(f"{node} of {name}", uri)

        master.call("getSystemState", (_CALLER,), listed, lambda _reason: again())
