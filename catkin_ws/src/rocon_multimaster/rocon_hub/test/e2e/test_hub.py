"""A real hub with a real Redis: it comes back, it never uses somebody else's, and it leaves nothing behind."""

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
import redis

from pioneer_harness.masters import Master
from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until
from rocon_hub.adapters.redis_server import RedisServer
from rocon_hub.adapters.registry import Registry
from rocon_hub.core.setting import HubSetting

# rosmaster, in our process here, leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning")


class Bench:
    def __init__(self, folder: Path) -> None:
        self.folder, self.group, self.master, self.ports = folder, ProcessGroup(), Master(), PortReservation()
        self.port = self.ports.take(17380)
        self.master.set_param("/hub", {"name": "Test Hub", "port": self.port})

    def start(self, name: str = "hub", **environment: str) -> int:
        argv = ["rosrun", "rocon_hub", "hub", f"__name:={name}", f"_port:={self.port}"]
        return self.group.start(name, argv, {**self.master.environment, **environment}, self.folder / f"{name}.log")

    def client(self, password: str | None = None) -> redis.Redis:
        return redis.Redis(port=self.port, password=password, decode_responses=True)

    def name(self, password: str | None = None) -> str | None:
        with self.client(password) as client:
            try:
                return client.get("rocon:hub:name")
            except redis.ConnectionError:
                return None

    def redis_pid(self) -> int:
        wait_until(self.name, "the hub's name", 10)
        with self.client() as client:
            return client.info("server")["process_id"]

    def close(self) -> None:
        self.group.stop()
        self.master.stop()
        self.ports.release()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.close()


def test_a_killed_redis_is_started_again(bench: Bench) -> None:
    bench.start()
    first = bench.redis_pid()
    os.kill(first, signal.SIGKILL)
    wait_until(lambda: bench.name() and bench.redis_pid() != first, "another Redis", 10)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_redis_outlives_its_hub(bench: Bench, number: signal.Signals) -> None:
    hub = bench.start()
    bench.redis_pid()
    os.kill(hub, number)
    wait_until(lambda: bench.name() is None, "Redis gone", 5)


def test_a_busy_port_is_one_clear_line_and_the_first_hub_goes_on(bench: Bench) -> None:
    bench.start()
    first = bench.redis_pid()
    bench.start("second")
    wait_until(lambda: not bench.group.is_running("second"), "the second hub's end", 10)
    assert f"port {bench.port} is in use" in (bench.folder / "second.log").read_text()
    assert bench.redis_pid() == first


def test_a_password_is_asked_for_and_kept_out_of_the_log(bench: Bench, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("open sesame\n")
    bench.start(ROCON_HUB_PASSWORD_FILE=str(secret))
    wait_until(lambda: bench.name("open sesame"), "the hub's name", 10)
    with bench.client() as client, pytest.raises(redis.AuthenticationError):
        client.get("rocon:hub:name")
    assert "open sesame" not in (bench.folder / "hub.log").read_text()


def test_a_gateway_that_joins_while_the_hub_looks_is_not_called_expired(bench: Bench, tmp_path: Path) -> None:
    # A frozen Redis once came back so: everybody joined, and was declared gone right after, for good.
    server = RedisServer(HubSetting(port=bench.port), tmp_path / "redis", None)
    bench.ports.release()
    server.start()
    try:
        client = server.client
        registry = Registry(client, 60.0)
        registry.open("Test Hub")
        client.sadd("rocon:gateways", "sleeper", "ghost")
        events = client.pubsub(ignore_subscribe_messages=True)
        events.subscribe("rocon:gateways")
        read = client.mget

        def read_and_be_overtaken(keys: list[str]) -> list[str | None]:
            lives = read(keys)
            client.set("rocon:alive:sleeper", "instance")
            return lives

        client.mget = read_and_be_overtaken
        assert registry.look() == {"ghost"}
        assert client.exists("rocon:lost:ghost", "rocon:lost:sleeper") == 1
        told = wait_until(lambda: events.get_message() or events.get_message(), "an event", 5)
        assert json.loads(told["data"]) == {"gateway": "ghost", "event": "expired"}
        assert events.get_message(timeout=0.1) is None
        events.close()
    finally:
        server.stop()


def test_strangers_cannot_reconfigure_the_server(bench: Bench) -> None:
    bench.start()
    bench.redis_pid()
    with bench.client() as client, pytest.raises(redis.ResponseError, match="unknown command"):
        client.config_set("dir", "/tmp")
