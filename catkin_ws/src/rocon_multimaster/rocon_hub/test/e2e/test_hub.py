"""A real hub with a real Redis: it recovers, never uses a foreign Redis, and leaves nothing behind."""

import contextlib
import itertools
import json
import os
import re
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import redis

from pioneer_harness.masters import Master
from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until
from rocon_hub.config import LONGEST_VALUE, HubConfig, quoted
from rocon_hub.redis_server import RedisServer
from rocon_hub.registry import Registry
from rocon_hub_protocol.address import HubAddress
from rocon_hub_protocol.redis_client import OPEN, Access, NotOurHubError, redis_client
from tcpros.descriptor import raise_limit

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


class Bench:
    def __init__(self, folder: Path) -> None:
        self.folder, self.group, self.master, self.ports = (
            folder,
            ProcessGroup(),
            Master(),
            PortReservation(),
        )
        self.port = self.ports.take(17380)
        self.home = folder / "home"
        self.master.set_param("/hub", {"name": "Test Hub", "port": self.port})

    def start(self, name: str = "hub", **environment: str) -> int:
        argv = ["rosrun", "rocon_hub", "hub", f"__name:={name}", f"_port:={self.port}"]
        environment = {**self.master.environment, "ROS_HOME": str(self.home), **environment}
        return self.group.start(name, argv, environment, self.folder / f"{name}.log")

    def client(self, password: str | None = None) -> redis.Redis:
        return redis_client(
            HubAddress("127.0.0.1", self.port), Access((lambda: password) if password else None)
        )

    def admin(self) -> redis.Redis:
        """Returns a client of the hub's own user, who has all permissions; only this OS user's processes can be one."""
        (configuration,) = self.home.glob("redis/*/redis.conf")
        (password,) = re.findall(
            r'^user hub reset on ">(\w+)"', configuration.read_text(), re.MULTILINE
        )
        folder = os.open(configuration.parent, os.O_PATH)
        path = f"/proc/self/fd/{folder}/redis.sock"
        return redis.Redis(
            unix_socket_path=path, username="hub", password=password, decode_responses=True
        )

    def name(self, password: str | None = None) -> str | None:
        with self.client(password) as client:
            try:
                return client.get("rocon:hub:name")
            except redis.ConnectionError:
                return None

    def redis_pid(self) -> int:
        def pid() -> int:
            with (
                self.client() as client,
                contextlib.suppress(redis.ConnectionError, redis.TimeoutError),
            ):
                return (
                    int(client.info("server")["process_id"]) if client.get("rocon:hub:name") else 0
                )
            return 0

        return wait_until(pid, "the hub's name", START)

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
    wait_until(lambda: bench.redis_pid() != first, "another Redis", 10)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_redis_outlives_its_hub(bench: Bench, number: signal.Signals) -> None:
    hub = bench.start()
    bench.redis_pid()
    os.kill(hub, number)
    wait_until(lambda: bench.name() is None, "Redis gone", 5)


def test_a_busy_port_is_one_clear_line_and_the_first_hub_continues(bench: Bench) -> None:
    bench.start()
    first = bench.redis_pid()
    bench.start("second")
    wait_until(lambda: not bench.group.is_running("second"), "the second hub's end", START)
    assert f"port {bench.port} is in use" in (bench.folder / "second.log").read_text()
    assert bench.redis_pid() == first


def test_a_password_is_asked_for_and_kept_out_of_the_log(bench: Bench, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("open sesame\n")
    bench.start(ROCON_HUB_PASSWORD_FILE=str(secret))
    wait_until(lambda: bench.name("open sesame"), "the hub's name", START)
    with bench.client() as client, pytest.raises(redis.AuthenticationError, match="wants a proof"):
        client.get("rocon:hub:name")
    with (
        bench.client("open barley") as client,
        pytest.raises(NotOurHubError, match="another password"),
    ):
        client.get("rocon:hub:name")
    assert "open sesame" not in (bench.folder / "hub.log").read_text()


def test_a_changed_password_file_applies_to_new_connections_only(
    bench: Bench, tmp_path: Path
) -> None:
    secret = tmp_path / "secret"
    secret.write_text("open sesame\n")
    bench.start(ROCON_HUB_PASSWORD_FILE=str(secret))
    wait_until(lambda: bench.name("open sesame"), "the hub's name", START)
    with bench.client("open sesame") as standing:
        assert standing.ping()
        secret.write_text("\n")  # invalid: the old one stays in use
        assert bench.name("open sesame") == "Test Hub"
        secret.write_text("open barley\n")
        assert bench.name("open barley") == "Test Hub"
        assert bench.name("open sesame") is None
        assert standing.get("rocon:hub:name") == "Test Hub"


def test_a_changed_password_changes_the_salt(bench: Bench, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("open sesame\n")
    bench.start(ROCON_HUB_PASSWORD_FILE=str(secret))
    wait_until(lambda: bench.name("open sesame"), "the hub's name", START)
    with bench.client("open sesame") as member:
        salt = member.get("rocon:hub:salt")
        secret.write_text("open barley\n")
        assert wait_until(lambda: member.get("rocon:hub:salt") not in (None, salt), "a salt", 10)


@pytest.fixture
def server(bench: Bench, tmp_path: Path) -> Iterator[RedisServer]:
    """A hub's Redis with default settings, without the hub."""
    made = RedisServer(HubConfig(port=bench.port), tmp_path / "redis", OPEN)
    made.start()
    yield made
    made.stop()


def test_a_gateway_that_joins_while_the_hub_looks_is_not_called_expired(
    server: RedisServer,
) -> None:
    # After a frozen Redis resumed, every gateway once joined and was declared lost right after, for good.
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
    assert list(registry.look(time.monotonic())) == ["ghost"]
    assert client.exists("rocon:lost:ghost", "rocon:lost:sleeper") == 1
    told = wait_until(lambda: events.get_message() or events.get_message(), "an event", 5)
    assert json.loads(told["data"]) == {"gateway": "ghost", "event": "expired"}
    assert events.get_message(timeout=0.1) is None
    events.close()


def test_of_whom_an_error_kept_the_hub_from_telling_it_tells_with_the_next_look(
    server: RedisServer,
) -> None:
    client = server.client
    registry = Registry(client, 60.0)
    registry.open("Test Hub")
    client.sadd("rocon:gateways", "first", "second")
    working, asked = client.eval, itertools.count()

    def fails_once(*arguments: object) -> object:
        if next(asked) == 1:
            raise redis.TimeoutError("Timeout reading from socket")
        return working(*arguments)

    client.eval = fails_once
    with pytest.raises(redis.TimeoutError):
        list(registry.look(time.monotonic()))
    assert list(registry.look(time.monotonic())) == ["second"]
    assert list(registry.look(time.monotonic())) == []


def test_a_thousand_gateways_find_room_when_they_come_back_at_once(
    bench: Bench, server: RedisServer
) -> None:
    raise_limit()
    count, port = 1000, bench.port
    with contextlib.ExitStack() as stack:
        ends = [
            stack.enter_context(socket.create_connection(("127.0.0.1", port), 30))
            for _ in range(2 * count)
        ]
        listening, speaking = ends[::2], ends[1::2]
        for one in listening:
            one.sendall(b"subscribe rocon:gateways\r\n")
        for number, one in enumerate(speaking):
            told = json.dumps(
                {"gateway": f"gateway{number:04}" + "0" * 32, "event": "joined"}
            ).replace('"', "'")
            said = [
                "multi",
                f"set rocon:gateway:{number} {'x' * 2000}",
                f"publish rocon:gateways {quoted(told)}",
                "exec\r\n",
            ]
            one.sendall("\r\n".join(said).encode())
        # No client has read anything yet, so all messages between them are queued in Redis.
        answers = [stack.enter_context(one.makefile("rb")) for one in speaking]
        said = [line for answer in answers for line in (answer.readline() for _ in range(6))]
        assert not [line for line in said if line.startswith(b"-")]
        used = server.client.info("memory")["used_memory_peak"]
    assert used > 64 * 2**20, "this was no crowd"


def test_a_full_hub_logs_once_and_accepts_gateways_when_there_is_room(bench: Bench) -> None:
    bench.master.set_param("/hub/max_memory", "8mb")
    bench.start()
    first = bench.redis_pid()
    log = bench.folder / "hub.log"
    with bench.admin() as client:
        events = client.pubsub(ignore_subscribe_messages=True)
        events.subscribe("rocon:gateways")
        client.sadd("rocon:gateways", "ghost")
        client.set("rocon:alive:ghost", "instance", px=1500)
        fill(client)
        # Each is reported once, but not both at the same moment.
        wait_until(events.get_message, "the event of the ghost's expiry", 10)
        wait_until(lambda: "ghost" in log.read_text(), "the line of it", 10)
        wait_until(lambda: "is full (8mb)" in log.read_text(), "the hub says that it is full", 15)
        late = start_gateway(bench, "late")
        wait_until(lambda: "OOM" in late.read_text(), "the gateway is not let in", START)
        client.delete(*client.keys("junk*"))
        wait_until(lambda: client.exists("rocon:gateway:late"), "the gateway is let in", 10)
        wait_until(lambda: "works again" in log.read_text(), "the hub says that all is well", 15)
        events.close()
    assert log.read_text().count("is full") == 1
    assert "Traceback" not in log.read_text()
    assert bench.redis_pid() == first


def test_a_full_redis_keeps_the_gateways_it_has_and_forgets_those_that_are_gone(
    bench: Bench,
) -> None:
    bench.master.set_param("/hub/max_memory", "8mb")
    bench.master.set_param("/hub/gateway_gone_timeout", 2.0)
    bench.start()
    bench.redis_pid()
    early = start_gateway(bench, "early")
    with bench.admin() as client:
        wait_until(lambda: client.exists("rocon:gateway:early"), "the gateway is let in", START)
        client.sadd("rocon:gateways", "ghost")
        client.set("rocon:gateway:ghost", "{}")
        fill(client)
        # A heartbeat counts for two seconds, so the ghost expires later than a gateway without a heartbeat would.
        wait_until(lambda: not client.exists("rocon:gateway:ghost"), "the ghost is forgotten", 30)
        assert client.smembers("rocon:gateways") == {"early"}
        assert client.exists("rocon:alive:early")
    assert "lost" not in early.read_text()


def start_gateway(bench: Bench, name: str) -> Path:
    """Starts a gateway on the bench's hub; returns its log."""
    uri, log = f"http://127.0.0.1:{bench.port}", bench.folder / f"{name}.log"
    bench.master.set_param("/gateway", {"name": name, "disable_uuids": True, "hub_uri": uri})
    bench.group.start(name, ["rosrun", "rocon_gateway", "gateway"], bench.master.environment, log)
    return log


def fill(client: redis.Redis) -> None:
    """Fills a Redis a few megabytes beyond its limit: Redis checks the limit before a command, not after it."""
    client.setrange("junk", 3_000_000, "x")
    with contextlib.suppress(redis.ResponseError):
        for number in itertools.count():
            client.set(f"junk{number}", "x" * 10_000)
    client.delete(*(f"junk{number}" for number in range(20)))
    client.copy("junk", "junk of junk")
    with pytest.raises(redis.ResponseError, match="OOM"):
        client.set("junk0", "x")


@pytest.mark.parametrize(
    "command",
    [
        ("EVAL", "while true do end", "0"),
        ("CLIENT", "PAUSE", "100000"),
        ("CLIENT", "KILL", "TYPE", "normal"),
        ("ACL", "SETUSER", "default", "on", "nopass", "+@all"),
        ("SYNC",),
        ("CONFIG", "SET", "dir", "/tmp"),
        ("FLUSHALL",),
        ("SHUTDOWN",),
        ("KEYS", "*"),
        ("SET", "rocon:hub:name", "Mallory's"),
        ("SET", "elsewhere", "x"),
        ("PUBLISH", "elsewhere", "x"),
    ],
    ids=" ".join,
)
def test_a_gateway_may_use_nothing_but_what_the_protocol_needs(
    bench: Bench, server: RedisServer, command: tuple[str, ...]
) -> None:
    """Each of the first five once stopped the hub for all clients."""
    Registry(server.client, 60.0).open("Test Hub")
    with bench.client() as client, pytest.raises(redis.exceptions.NoPermissionError):
        client.execute_command(*command)
    assert server.client.get("rocon:hub:name") == "Test Hub"


def test_a_record_that_is_too_long_is_refused(bench: Bench, server: RedisServer) -> None:
    """Gateways that read a record of 25 MB once sent no heartbeat meanwhile, and the others declared them lost."""
    Registry(server.client, 60.0).open("Test Hub")
    with bench.client() as client, pytest.raises((redis.ResponseError, redis.ConnectionError)):
        client.set("rocon:gateway:ghost", "x" * (LONGEST_VALUE + 1))
    with bench.client() as client:
        client.set("rocon:gateway:ghost", "x" * 1_000_000)
    assert server.client.strlen("rocon:gateway:ghost") == 1_000_000


def test_a_redis_whose_users_were_changed_is_started_again(bench: Bench) -> None:
    bench.start()
    first = bench.redis_pid()
    with bench.admin() as admin:
        admin.execute_command("ACL", "SETUSER", "default", "+@all")
    wait_until(lambda: bench.redis_pid() != first, "another Redis", 10)
    assert (
        "users or permissions that this hub did not set" in (bench.folder / "hub.log").read_text()
    )
    with bench.client() as client, pytest.raises(redis.exceptions.NoPermissionError):
        client.flushall()


def test_a_redis_that_stops_answering_is_started_again(bench: Bench) -> None:
    bench.start()
    first = bench.redis_pid()
    os.kill(first, signal.SIGSTOP)
    wait_until(lambda: bench.redis_pid() not in (0, first), "another Redis", 40)
    assert "has not answered" in (bench.folder / "hub.log").read_text()
