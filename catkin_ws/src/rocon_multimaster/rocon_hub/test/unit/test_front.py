"""The hub's port when a password is set."""

import asyncio
import contextlib
import logging
import os
import resource
import socket
import ssl
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from pioneer_harness.port import PortReservation
from pioneer_harness.wait import wait_until
from rocon_hub import front
from rocon_hub.front import HANDSHAKE_TIME, Front
from rocon_hub.guess import LONGEST_DELAY
from rocon_hub_protocol.admission import BUSY, GatewaySide
from tcpros.descriptor import raise_limit

CROWD = 600
PATIENCE = 60.0


@contextlib.contextmanager
def listening(
    redis: str = "", context: ssl.SSLContext | None = None
) -> Iterator[tuple[int, Front]]:
    """Yields a port and the front that listens on it."""
    with contextlib.ExitStack() as stack:
        ports = PortReservation()
        stack.callback(ports.release)
        port = ports.take(17380)
        made = Front(port, redis, lambda: "open sesame", context)
        stack.callback(made.close)
        yield port, made


def line(connection: socket.socket) -> bytes:
    """Reads a line; returns an empty one if the hub has closed the connection."""
    said = b""
    while not said.endswith(b"\n") and (more := connection.recv(512)):
        said += more
    return said


def test_gateways_that_come_all_at_once_are_admitted_at_their_first_attempt(tmp_path: Path) -> None:
    """With more than 256 clients, the hub once closed the oldest, which reconnected and displaced others."""
    raise_limit()
    with contextlib.ExitStack() as stack:
        port, _ = stack.enter_context(listening(str(tmp_path / "redis")))
        redis = stack.enter_context(socket.socket(socket.AF_UNIX))
        redis.bind(str(tmp_path / "redis"))
        redis.listen(CROWD)
        crowd = [
            (socket.create_connection(("127.0.0.1", port), PATIENCE), GatewaySide("open sesame"))
            for _ in range(CROWD)
        ]
        for connection, side in crowd:
            stack.enter_context(connection)
            connection.sendall(side.first)
        for connection, side in crowd:
            connection.sendall(side.prove(line(connection)))
        assert all(side.accepts(line(connection)) for connection, side in crowd)


def test_clients_that_leave_while_they_wait_do_not_pile_up() -> None:
    """Each client that connected, began and left once cost a turn, so with many the queue grew without bound."""
    with listening() as (port, made):
        asyncio.run_coroutine_threadsafe(made._turn.acquire(), made._loop).result(PATIENCE)
        for _ in range(100):
            with socket.create_connection(("127.0.0.1", port), PATIENCE) as one:
                one.sendall(GatewaySide("open sesame").first)
        with socket.create_connection(("127.0.0.1", port), PATIENCE) as last:
            last.sendall(GatewaySide("open sesame").first)
            wait_until(
                lambda: len(asyncio.all_tasks(made._loop)) == len(made._sockets) + 2,
                "the others' end",
                PATIENCE,
            )
            made._loop.call_soon_threadsafe(made._turn.release)
            assert line(last)


@pytest.mark.parametrize(
    "context", [None, ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)], ids=["plain", "tls"]
)
def test_who_says_nothing_is_closed(
    monkeypatch: pytest.MonkeyPatch, context: ssl.SSLContext | None
) -> None:
    """With TLS, such a client could once stay for a minute without being counted."""
    monkeypatch.setattr(front, "HANDSHAKE_TIME", 0.2)
    with (
        listening(context=context) as (port, _),
        socket.create_connection(("127.0.0.1", port), 10.0) as silent,
    ):
        assert silent.recv(1) == b""


def test_stalled_tls_handshakes_count_as_clients_that_have_not_proved_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They once counted only from the end of the handshake, so any number of them could hold a descriptor for 5 s."""
    monkeypatch.setattr(front, "MAX_UNPROVEN", 3)
    with (
        listening(context=ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)) as (port, _),
        contextlib.ExitStack() as stack,
    ):
        monkeypatch.setattr(front, "HANDSHAKE_TIME", PATIENCE)
        crowd = [
            stack.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE / 2))
            for _ in range(front.MAX_UNPROVEN + 1)
        ]
        assert crowd[0].recv(1) == b""
        crowd[1].settimeout(0.1)
        with pytest.raises(TimeoutError):
            crowd[1].recv(1)


@contextlib.contextmanager
def files_open_at_most(most: int) -> Iterator[None]:
    """Lowers this process's limit of open files."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def lowest_unused() -> int:
    os.close(unused := os.dup(0))
    return unused


def test_where_few_files_may_be_open_fewer_unproven_clients_are_held(
    caplog: pytest.LogCaptureFixture,
) -> None:
    few = 2 * max(map(int, os.listdir("/proc/self/fd"))) + 40
    with files_open_at_most(few), contextlib.ExitStack() as stack:
        with caplog.at_level(logging.WARNING, "rosout"):
            port, _ = stack.enter_context(listening())
        assert f"at most {few // 4} gateways" in caplog.text
        crowd = [
            stack.enter_context(socket.create_connection(("127.0.0.1", port), HANDSHAKE_TIME / 2))
            for _ in range(few // 4 + 1)
        ]
        assert crowd[0].recv(1) == b""


def test_a_client_is_answered_where_others_hold_all_files_that_may_be_open() -> None:
    """Before, no client was accepted until the others left."""
    with listening() as (port, _), contextlib.ExitStack() as stack:
        crowd = [stack.enter_context(socket.socket()) for _ in range(30)]
        with files_open_at_most(lowest_unused() + 4):
            for one in crowd:
                one.settimeout(HANDSHAKE_TIME / 2)
                one.connect(("127.0.0.1", port))
            crowd[-1].sendall(GatewaySide("open sesame").first)
            assert line(crowd[-1]).startswith(b"+")


def test_a_front_that_is_closed_while_it_starts_leaves_no_socket() -> None:
    """If closed before its loop had taken over the sockets, it once ended with a traceback and left them open."""
    with PortReservation() as ports:
        port = ports.take(17380)
        for _ in range(20):
            Front(port, "", lambda: "open sesame", None).close()


def guess(port: int, password: str, patience: float = PATIENCE) -> bytes:
    """Tries a password at the hub's port; returns the hub's answer."""
    side = GatewaySide(password)
    with socket.create_connection(("127.0.0.1", port), patience) as connection:
        connection.sendall(side.first)
        connection.sendall(side.prove(line(connection)))
        return line(connection)


def test_wrong_passwords_slow_their_host_down(caplog: pytest.LogCaptureFixture) -> None:
    """A host could once try 1,200 passwords a second. In parallel, no more proofs are checked than in a row."""
    answers: list[bytes] = []
    with listening() as (port, _), ThreadPoolExecutor(16) as pool:
        assert guess(port, "0").startswith(b"-WRONGPASS")
        began = time.monotonic()
        while time.monotonic() - began < 3.0:
            answers += pool.map(lambda number: guess(port, str(number)), range(16))
        spent = time.monotonic() - began
        checked = sum(answer.startswith(b"-WRONGPASS") for answer in answers)
        assert 1 <= checked <= 4 + spent / LONGEST_DELAY
        assert answers.count(BUSY) == len(answers) - checked > 16
    assert caplog.text.count("does not know the hub's password") == 1


def test_a_gateway_with_the_password_is_admitted_although_its_host_fails(tmp_path: Path) -> None:
    with contextlib.ExitStack() as stack:
        redis = stack.enter_context(socket.socket(socket.AF_UNIX))
        redis.bind(str(tmp_path / "redis"))
        redis.listen()
        port, _ = stack.enter_context(listening(str(tmp_path / "redis")))
        for number in range(6):
            assert guess(port, str(number)).startswith(b"-WRONGPASS")
        assert guess(port, "open sesame", HANDSHAKE_TIME).startswith(b"+")


def test_failures_are_counted_in_the_log_until_they_stop(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(front, "MEMORY", 2.0)
    with listening() as (port, made):
        for number in range(3):
            guess(port, str(number))
        wait_until(lambda: "another 2 times" in caplog.text, "the report", PATIENCE)
        wait_until(lambda: not made._failing._hosts, "the host to be forgotten", PATIENCE)
    assert caplog.text.count("clients at 127.0.0.1 failed") == 1
