"""Tells dead nodes from others: a killed node stays registered, but nothing listens at its address any more.

Only a refused connection means that a node is dead. The kernel accepts connections for a node that is frozen or busy,
and a host that does not answer may be behind a cut network.
"""

import http.client
import logging
import socket
import threading
from collections.abc import Callable

from rocon_gateway.master.line import MasterError, MasterLine, UnknownError, request, value
from rocon_relay.connection import is_proxy_uri
from tcpros.loop_faults import LoopFaults
from tcpros.xmlrpc_client import host_and_port

TIMEOUT = 2.0
"""How long a node's host may take to answer [s]."""

PERIOD = 3.0
"""Time between two examinations of the same nodes [s]."""


class MasterCaller:
    """Calls a master. Each call may fail with MasterError; UnknownError means that the name is unknown.

    Args:
        uri: URI of the master.
        node: our own node's name.
    """

    def __init__(self, uri: str, node: str) -> None:
        self._uri = uri
        self._node = node

    def call(self, method: str, *arguments: str) -> object:
        """Returns the value in the master's answer. Raises MasterError."""
        return self.call_as(self._node, method, *arguments)

    def call_as(self, caller: str, method: str, *arguments: str) -> object:
        """Calls in the name of another node. Raises MasterError."""
        line = MasterLine(self._uri)
        try:
            return value(line.ask(request(method, caller, *arguments)))
        except (http.client.HTTPException, OSError) as error:
            raise MasterError(f"the ROS master does not answer: {error}") from None
        finally:
            line.close()


def refuses(uri: str) -> bool:
    """Returns whether the host of a URI answers that nothing listens at its port."""
    try:
        host, port = host_and_port(uri)
        if not (host and port):
            return False
        socket.create_connection((host, port), TIMEOUT).close()
    except ConnectionRefusedError:
        return True
    except (OSError, ValueError):
        return False
    return False


def name_of(uri: str, caller: str) -> str | None:
    """Returns the name of the node that serves the slave API at a URI; None if no node answers."""
    try:
        line = MasterLine(uri)
    except ValueError:  # the URI is none
        return None
    try:
        return str(value(line.ask(request("getName", caller))))
    except (http.client.HTTPException, OSError, MasterError):
        return None
    finally:
        line.close()


class NodeExaminer:
    """Examines again and again whether some nodes are dead, in a thread of its own while there are any.

    Args:
        uri: URI of the master.
        node: our own node's name.
        changed: called from that thread when `dead` has changed.
    """

    def __init__(self, uri: str, node: str, changed: Callable[[], object]) -> None:
        self._caller = MasterCaller(uri, node)
        self._changed = changed
        self._lock = threading.Lock()
        self._nodes: frozenset[str] = frozenset()
        self._dead: frozenset[str] = frozenset()
        self._is_told = True
        self._thread: threading.Thread | None = None
        self._woken = threading.Event()
        self._faults = LoopFaults(logging.getLogger("rosout"), "the examination of nodes")

    @property
    def dead(self) -> frozenset[str]:
        """Those of the examined nodes that were dead at the last examination."""
        return self._dead

    def examine(self, nodes: frozenset[str]) -> None:
        """Sets the nodes to examine; returns at once."""
        with self._lock:
            if nodes == self._nodes:
                return
            self._nodes = nodes
            self._dead &= nodes
            self._woken.set()
            if nodes and self._thread is None:
                self._start()

    def _start(self) -> None:
        thread = threading.Thread(target=self._run, name="examine", daemon=True)
        try:
            thread.start()
        except RuntimeError as error:  # no more threads on this machine
            self._nodes = frozenset()  # so that the next call tries again
            self._faults.take(error)
        else:
            self._thread = thread

    def _run(self) -> None:
        while True:
            self._woken.clear()
            with self._lock:
                nodes = self._nodes
                if not nodes:
                    self._thread = None
                    return
            with self._faults:
                self._examine_all(nodes)
            self._woken.wait(PERIOD)

    def _examine_all(self, nodes: frozenset[str]) -> None:
        found = frozenset(node for node in nodes if self._is_dead(node))
        with self._lock:
            found &= self._nodes
            self._is_told = self._is_told and found == self._dead
            self._dead = found
        if not self._is_told:
            self._changed()
            self._is_told = True

    def _is_dead(self, node: str) -> bool:
        try:
            uri = str(self._caller.call("lookupNode", node))
        except UnknownError:
            return True  # it has been unregistered meanwhile
        except MasterError:
            return False
        # A proxy took the place of a dead node of the same name.
        return is_proxy_uri(uri) or refuses(uri)
