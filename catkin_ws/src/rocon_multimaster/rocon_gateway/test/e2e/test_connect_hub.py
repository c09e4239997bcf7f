"""`connect_hub`: every outcome has its own code, and a refusal is not remembered."""

import logging
from collections.abc import Callable, Iterator

import pytest
import redis

from pioneer_harness.masters import is_running
from pioneer_harness.wait import START, wait_until
from rocon_gateway.doctor.examiner import Examiner
from rocon_gateway.hub.hubs import Hubs, HubsConfig
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.key import NAME_KEY, PROTOCOL_KEY
from rocon_hub_protocol.record import PROTOCOL, Record
from rocon_hub_protocol.redis_client import Access

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

Connect = Callable[..., Code]


@pytest.fixture
def connect() -> Iterator[Connect]:
    """Calls what the service calls, for a gateway with the given settings; returns the service's result code."""
    made: dict[str, Hubs] = {}

    def call(uri: str, name: str = "caller", **settings: object) -> Code:
        if name not in made:
            made[name] = Hubs(
                HubsConfig(**settings),
                Record(name, name, "", 1),
                set,
                list,
                logging.getLogger(name),
                Examiner().asked,
            )
        try:
            made[name].connect(uri)
        except HubError as error:
            return error.code
        return Code.SUCCESS

    yield call
    for hubs in made.values():
        hubs.shutdown()


@pytest.fixture
def strange_redis(fleet) -> str:
    """The address of a Redis that is not a hub."""
    port = fleet.ports.take(17380)
    fleet.group.start(
        "redis", ["redis-server", "--port", str(port), "--save", ""], {}, fleet.folder / "redis.log"
    )
    wait_until(lambda: is_running(f"http://127.0.0.1:{port}"), "the server", START)
    return f"http://127.0.0.1:{port}"


def test_connect_hub_takes_an_address_without_a_scheme(fleet, connect) -> None:
    fleet.start_hub()
    wait_until(lambda: is_running(fleet.hub_uri), "the hub's port", START)
    assert wait_until(
        lambda: connect(f"127.0.0.1:{fleet.hub_port}") == Code.SUCCESS, "on the hub", 20
    )
    assert connect(fleet.hub_uri) == Code.HUB_CONNECTION_ALREADY_EXISTS
    barred = {"blacklist": (fleet.hub_name,)}
    assert connect(fleet.hub_uri, "barred", **barred) == Code.HUB_CONNECTION_BLACKLISTED
    unlisted = {"whitelist": ("Another Hub",)}
    assert (
        connect(fleet.hub_uri, "unlisted", **unlisted)
        == Code.HUB_CONNECTION_NOT_IN_NONEMPTY_WHITELIST
    )
    assert (
        connect(fleet.hub_uri, "wrong", access=Access(lambda: "not its password"))
        == Code.HUB_CONNECTION_FAILED
    )


def test_each_call_of_connect_hub_looks_again(strange_redis, connect) -> None:
    assert connect("http://127.0.0.1:9") == Code.HUB_CONNECTION_UNRESOLVABLE
    assert connect("two words") == Code.HUB_CONNECTION_UNRESOLVABLE
    assert connect(strange_redis) == Code.HUB_NAME_NOT_FOUND
    port = int(strange_redis.rpartition(":")[2])
    with redis.Redis(port=port) as client:
        client.mset({NAME_KEY: "A Hub Now", PROTOCOL_KEY: PROTOCOL})
    assert connect(strange_redis) == Code.SUCCESS
