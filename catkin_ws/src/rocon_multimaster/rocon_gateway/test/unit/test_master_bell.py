"""When the gateway polls its master: at once if the master reports changes, else periodically, always with a pause."""

import os
import threading
import time
import xmlrpc.client
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from rocon_gateway.master.bell import LOOK_PERIOD, LOOKS_AT_ONCE, MasterBell, Ration

PATIENCE = 20.0


class TellingMaster(ThreadingHTTPServer):
    """Answers as many requests as the test permits through `let`, each with `said`."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.asked, self.let, self.count = threading.Semaphore(0), threading.Semaphore(0), 0
        self.questions = 0
        self.knows = True

    def said(self) -> bytes:
        if not self.knows:
            return xmlrpc.client.dumps(xmlrpc.client.Fault(1, "no such method")).encode()
        self.count += 1
        return xmlrpc.client.dumps(
            ((1, "registrations", self.count),), methodresponse=True
        ).encode()


class _Handler(BaseHTTPRequestHandler):
    server: TellingMaster
    protocol_version = "HTTP/1.1"

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.server.questions += 1
        self.server.asked.release()
        self.server.let.acquire()
        said = self.server.said()
        self.send_response(200)
        self.send_header("Content-Length", str(len(said)))
        self.end_headers()
        self.wfile.write(said)

    def log_message(self, format: str, *args: object) -> None:
        """Suppresses logging."""


@pytest.fixture
def master() -> Iterator[TellingMaster]:
    made = TellingMaster()
    thread = threading.Thread(target=made.serve_forever, args=(0.01,))
    thread.start()
    yield made
    made.let.release(1000)
    made.shutdown()
    thread.join()
    made.server_close()


@pytest.fixture
def bell(master: TellingMaster) -> Iterator[MasterBell]:
    made = MasterBell(f"http://127.0.0.1:{master.server_port}/", "/gateway")
    yield made
    made.close()


@pytest.fixture
def reader() -> Iterator[int]:
    ends = os.pipe()
    yield ends[0]
    for one in ends:
        os.close(one)


def told(master: TellingMaster, bell: MasterBell, reader: int) -> None:
    """Lets the bell learn that this master reports changes."""
    master.let.release()
    bell.wait(reader)


def test_a_registration_ends_the_wait_at_once(
    master: TellingMaster, bell: MasterBell, reader: int
) -> None:
    told(master, bell, reader)
    began = time.monotonic()
    master.let.release()
    assert not bell.wait(reader)
    assert time.monotonic() - began < LOOK_PERIOD


def test_a_master_that_tells_is_looked_at_only_when_it_has_told(
    master: TellingMaster, bell: MasterBell, reader: int
) -> None:
    told(master, bell, reader)
    assert bell.is_due
    for _ in range(3):
        assert not bell.wait(reader, LOOK_PERIOD)
        assert not bell.is_due
    bell.look_again()
    assert not bell.wait(reader, LOOK_PERIOD)
    assert bell.is_due
    master.let.release()
    assert not bell.wait(reader)
    assert bell.is_due


def test_a_wake_of_ours_ends_the_wait_and_is_reported(
    master: TellingMaster, bell: MasterBell
) -> None:
    reader, writer = os.pipe()
    os.write(writer, b"x")
    assert bell.wait(reader)
    os.close(reader)
    os.close(writer)


def test_many_registrations_cost_a_look_each_period_after_the_first_few(
    master: TellingMaster, bell: MasterBell, reader: int
) -> None:
    master.let.release(1000)
    began = time.monotonic()
    for _ in range(LOOKS_AT_ONCE + 4):
        bell.wait(reader)
    assert time.monotonic() - began >= 3 * LOOK_PERIOD


def test_pauses_that_something_else_ended_do_not_add_up() -> None:
    ration = Ration(0.15, 5)
    assert [ration.take(0.0) for _ in range(5)] == [0.0] * 5
    assert max(ration.take(0.001 * number) for number in range(1000)) <= 0.15


def test_a_master_that_cannot_tell_is_asked_once_and_looked_at_each_period(
    master: TellingMaster, bell: MasterBell, reader: int
) -> None:
    master.knows = False
    told(master, bell, reader)
    began = time.monotonic()
    for _ in range(3):
        assert not bell.wait(reader)
    assert time.monotonic() - began >= 2.9 * LOOK_PERIOD
    assert master.questions == 1


def test_a_master_that_ends_is_looked_at_each_period(reader: int) -> None:
    master = TellingMaster()
    bell = MasterBell(f"http://127.0.0.1:{master.server_port}/", "/gateway")
    master.server_close()
    began = time.monotonic()
    for _ in range(3):
        assert not bell.wait(reader)
    assert 2.9 * LOOK_PERIOD <= time.monotonic() - began < PATIENCE
    bell.close()
