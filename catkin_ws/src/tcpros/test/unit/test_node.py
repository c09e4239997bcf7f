"""A node registers at the master and unregisters."""

import logging
import threading
from collections.abc import Iterator
from socketserver import ThreadingMixIn
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from std_msgs.msg import String

from tcpros.node import Node
from tcpros.node_context import NodeContext
from tcpros.reactor import Reactor

SLOW = 0.5
"""How long the master takes to register [s], unless the node unregisters meanwhile."""
HANGS = 20.0


class SlowMaster(ThreadingMixIn, SimpleXMLRPCServer):
    """Executes calls in parallel, like rosmaster, and registers slowly; records calls in the order of execution."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), logRequests=False)
        self.executed: list[str] = []
        self._unregisters = threading.Event()
        self.register_instance(self)

    def _dispatch(self, method: str, _arguments: object) -> tuple[int, str, list[str]]:
        if method.startswith("unregister"):
            self._unregisters.set()
        else:
            self._unregisters.wait(SLOW)
        self.executed.append(method)
        return 1, "", []


@pytest.fixture
def master() -> Iterator[SlowMaster]:
    with SlowMaster() as made:
        thread = threading.Thread(target=made.serve_forever)
        thread.start()
        yield made
        made.shutdown()
        thread.join()


@pytest.fixture
def context(master: SlowMaster) -> NodeContext:
    logger = logging.getLogger("node")
    uri = f"http://127.0.0.1:{master.server_address[1]}"
    return NodeContext(Reactor(logger), uri, "127.0.0.1", "127.0.0.1", logger)


def run_for(context: NodeContext) -> None:
    """Runs the event loop until it is stopped; fails after `HANGS`."""
    overdue = []
    context.reactor.call_later(HANGS, lambda: (overdue.append(True), context.reactor.stop()))
    context.reactor.run()
    assert not overdue


def test_a_node_that_ends_while_it_registers_does_not_stay_registered(
    master: SlowMaster, context: NodeContext
) -> None:
    node = Node(context, "/one", lambda _: None)
    node.publish("/words", String)
    node.close(context.reactor.stop)
    run_for(context)
    assert master.executed == ["registerPublisher", "unregisterPublisher"]


def test_a_subscription_that_ends_while_it_registers_does_not_stay(
    master: SlowMaster, context: NodeContext
) -> None:
    node = Node(context, "/one", lambda _: None)
    node.subscribe("/words", String, lambda *_: None)
    node.unsubscribe("/words")
    node.when_registered(lambda: node.close(context.reactor.stop))
    run_for(context)
    assert master.executed == ["registerSubscriber", "unregisterSubscriber"]


def test_a_node_that_ends_with_a_subscription_that_just_ended_leaves_none(
    master: SlowMaster, context: NodeContext
) -> None:
    node = Node(context, "/one", lambda _: None)
    node.subscribe("/words", String, lambda *_: None)
    node.unsubscribe("/words")
    node.close(context.reactor.stop)
    run_for(context)
    assert master.executed == ["registerSubscriber", "unregisterSubscriber"]
