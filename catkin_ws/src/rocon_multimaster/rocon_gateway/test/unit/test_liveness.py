"""Dead nodes: a refused connection is the only proof."""

import contextlib
import os
import socket
import threading
import xmlrpc.client
from collections.abc import Iterator
from xmlrpc.server import SimpleXMLRPCServer

import pytest

from pioneer_harness.masters import Master
from pioneer_harness.wait import wait_until
from rocon_gateway.master.leftovers import remove_leftovers
from rocon_gateway.master.liveness import NodeExaminer, name_of, refuses
from rocon_relay.connection import proxy_uri

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


@pytest.fixture
def master() -> Iterator[Master]:
    with Master() as made:
        yield made


@contextlib.contextmanager
def port(accepts: bool) -> Iterator[int]:
    """A reserved port: connections are accepted by the kernel, but never answered, or refused."""
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        if accepts:
            sock.listen()
        yield sock.getsockname()[1]


@contextlib.contextmanager
def slave_api(name: str) -> Iterator[int]:
    """The port of a node with that name; its PID is ours, as it may be in another container."""
    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        server.register_function(lambda _caller: (1, "", name), "getName")
        server.register_function(lambda _caller: (1, "", os.getpid()), "getPid")
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield server.server_address[1]
        server.shutdown()
        thread.join()


def register(master: Master, node: str, uri: str, topic: str = "/chatter") -> None:
    api = xmlrpc.client.ServerProxy(master.uri)
    with api:
        assert api.registerPublisher(node, topic, "std_msgs/String", uri)[0] == 1


def test_a_frozen_node_refuses_nothing() -> None:
    with port(accepts=True) as frozen, port(accepts=False) as dead:
        assert not refuses(f"http://127.0.0.1:{frozen}/")
        assert refuses(f"http://127.0.0.1:{dead}/")
    assert not refuses("http://no-such-host.invalid:1/")
    assert not refuses("nonsense")
    assert not refuses("http://127.0.0.1:nonsense/")


def test_an_examiner_tells_the_dead_from_the_frozen_and_notices_a_return(master: Master) -> None:
    changes = threading.Semaphore(0)
    examiner = NodeExaminer(master.uri, "/gateway", changes.release)
    with port(accepts=True) as frozen, port(accepts=False) as dead:
        register(master, "/frozen", f"http://127.0.0.1:{frozen}/")
        register(master, "/dead", f"http://127.0.0.1:{dead}/")
        examiner.examine(frozenset({"/frozen", "/dead"}))
        assert changes.acquire(timeout=5)
        assert examiner.dead == {"/dead"}
        register(master, "/dead", f"http://127.0.0.1:{frozen}/")
        assert changes.acquire(timeout=10), "it runs again"
        assert examiner.dead == frozenset()
        examiner.examine(frozenset())
        wait_until(
            lambda: all(one.name != "examine" for one in threading.enumerate()), "the end", 5
        )


@pytest.mark.parametrize("unique", ["", "0123456789abcdef" * 2], ids=["plain", "unique name"])
def test_a_restarted_gateway_removes_its_dead_proxies_only(master: Master, unique: str) -> None:
    """A living gateway of the same name, in another container, may have the same PID."""
    with (
        port(accepts=False) as dead,
        slave_api("/gateway") as taken,
        slave_api("/far/twin") as twin,
    ):
        rows = {
            "/far/dead": proxy_uri("127.0.0.1", dead, "me" + unique),
            "/far/taken": proxy_uri("127.0.0.1", taken, "me" + unique),
            "/far/twin": proxy_uri("127.0.0.1", twin, "me" + unique),
            "/other/dead": proxy_uri("127.0.0.1", dead, "you"),
            "/crashed": f"http://127.0.0.1:{dead}/",
        }
        for node, uri in rows.items():
            register(master, node, uri)
        register(master, "/far/dead", rows["/far/dead"], "/second")
        api = xmlrpc.client.ServerProxy(master.uri)
        with api:
            api.registerService(
                "/far/dead", "/add", f"rosrpc://127.0.0.1:{dead}", rows["/far/dead"]
            )
        removed = remove_leftovers(master.uri, "/gateway", "me" + unique[::-1])
        assert removed == ["/far/dead", "/far/taken"]
        publishers, _, services = master.system_state()
        assert sorted(publishers["/chatter"]) == ["/crashed", "/far/twin", "/other/dead"]
        assert "/second" not in publishers
        assert services == {}


@pytest.mark.parametrize("uri", ["http://[::1:1/", "http://:1234/", "http://host:99999/", "x", ""])
def test_an_address_that_is_none_is_not_dead_and_raises_nothing(uri):
    assert not refuses(uri)
    assert name_of(uri, "/test") is None
