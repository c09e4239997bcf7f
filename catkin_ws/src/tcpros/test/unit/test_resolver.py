"""Host names are looked up without delaying each other."""

import logging
import socket
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from tcpros import resolver
from tcpros.reactor import Reactor
from tcpros.resolver import Resolver
from tcpros.xmlrpc_client import host_and_port

PATIENCE = 20.0


@pytest.fixture
def reactor() -> Iterator[Reactor]:
    made = Reactor(logging.getLogger("resolver"))
    made.start()
    yield made
    made.call(made.stop)
    made.join(PATIENCE)


class Names:
    """Stands in for the system's look-up: names that start with `dead` fail, but only once `silence` ends."""

    def __init__(self) -> None:
        self.silence = threading.Event()
        self.asked = Counter[str]()

    def look_up(self, host: str, *_: Any) -> list[Any]:
        self.asked[host] += 1
        if host.startswith("dead"):
            self.silence.wait(PATIENCE)
            raise socket.gaierror(-3, "Temporary failure in name resolution")
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("10.0.0.7", 0))]


@pytest.fixture
def names(monkeypatch: pytest.MonkeyPatch) -> Iterator[Names]:
    made = Names()
    monkeypatch.setattr(socket, "getaddrinfo", made.look_up)
    yield made
    made.silence.set()


class Answers:
    """The answers to a number of questions."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.texts: list[str] = []
        self.complete = threading.Event()

    def take(self, text: str) -> None:
        self.texts.append(text)
        if len(self.texts) == self.number:
            self.complete.set()


@pytest.fixture
def ask(reactor: Reactor) -> Callable[..., Answers]:
    resolver = Resolver(reactor)

    def ask(*hosts: str) -> Answers:
        answers = Answers(len(hosts))
        for host in hosts:
            reactor.call(lambda h=host: resolver.resolve(h, answers.take, answers.take))  # type: ignore[misc]
        return answers

    return ask


@pytest.mark.parametrize("host", ["::1", "six"])
def test_a_name_with_an_ipv6_address_only_says_so(
    ask: Callable[..., Answers], monkeypatch: pytest.MonkeyPatch, host: str
) -> None:
    def look_up(_host: str, _port: None, family: socket.AddressFamily, *_: Any) -> list[Any]:
        if family == socket.AF_INET:
            raise socket.gaierror(-5, "No address associated with hostname")
        return [(socket.AF_INET6, socket.SOCK_STREAM, 6, "", ("fd00::7", 0, 0, 0))]

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    answers = ask(host)
    assert answers.complete.wait(PATIENCE)
    assert f"{host} has an IPv6 address only" in answers.texts[0]


def test_names_that_do_not_resolve_delay_no_other(
    ask: Callable[..., Answers], names: Names
) -> None:
    dead = ask(*(f"dead{number}" for number in range(15)))
    alive = ask("alive")
    assert alive.complete.wait(PATIENCE)
    assert alive.texts == ["10.0.0.7"]
    assert not dead.texts
    names.silence.set()
    assert dead.complete.wait(PATIENCE)


def test_more_names_than_threads_are_all_answered(
    ask: Callable[..., Answers], names: Names
) -> None:
    dead = ask(*(f"dead{number}" for number in range(50)))
    alive = ask("alive")
    names.silence.set()
    assert dead.complete.wait(PATIENCE)
    assert alive.complete.wait(PATIENCE)


def test_equal_questions_are_one_look_up_and_its_failure_is_remembered(
    ask: Callable[..., Answers], names: Names
) -> None:
    first = ask(*["dead"] * 10)
    names.silence.set()
    assert first.complete.wait(PATIENCE)
    again = ask("dead")
    assert again.complete.wait(PATIENCE)
    assert names.asked["dead"] == 1
    assert set(first.texts + again.texts) == {
        "the name dead cannot be resolved: Temporary failure in name resolution"
    }


def test_malformed_names_are_answered_too(ask: Callable[..., Answers]) -> None:
    answers = ask("hub..lan", "x" * 300, "nul\0", "\udcff", "127.0.0.1")
    assert answers.complete.wait(PATIENCE)
    assert sum("cannot be resolved" in text for text in answers.texts) == 4


@pytest.mark.parametrize(
    ("uri", "host", "port"),
    [
        ("http://robot:40000/", "robot", 40000),
        ("http://[::1]:40000/", "::1", 40000),
        ("http://::1:40000/", "::1", 40000),
        ("http://robot/", "robot", 0),
        ("http://robot:x/", "", 0),
        ("http://fe80::1%eth0:40000/", "fe80::1%eth0", 40000),
        ("http://::x/", "", 0),
        ("http://::1/", "", 0),
        ("http://::1:-5/", "", 0),
        ("http://::1:70000/", "", 0),
        ("http://::1:4_0/", "", 0),
        ("http://::1:+40/", "", 0),
        ("http://robot:70000/", "", 0),
        ("http://robot:1:40000/", "", 0),
        ("http://robot:40000/\udcff", "", 0),
        ("http://user:word@robot:40000/", "robot", 40000),
        ("nonsense", "", 0),
    ],
)
def test_host_and_port_of_an_address_also_as_rospy_writes_ipv6(
    uri: str, host: str, port: int
) -> None:
    assert host_and_port(uri) == (host, port)


class AtOnce:
    """Replaces threads and the loop: everything runs at once."""

    refusals = 0

    def __init__(self, target: Callable[..., object], args: tuple[str, ...], **_: object) -> None:
        self._run = partial(target, *args)

    def start(self) -> None:
        if AtOnce.refusals:
            AtOnce.refusals -= 1
            raise RuntimeError("can't start new thread")
        self._run()


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names that are looked up; all exist."""
    names = list[str]()

    def found(host: str, *_: object) -> list[object]:
        names.append(host)
        return [(2, 1, 6, "", ("10.0.0.1", 0))]

    monkeypatch.setattr(resolver.socket, "getaddrinfo", found)
    monkeypatch.setattr(resolver, "threading", SimpleNamespace(Thread=AtOnce))
    return names


def test_an_address_is_looked_up_again_once_it_has_expired_and_then_forgotten(
    monkeypatch: pytest.MonkeyPatch, asked: list[str]
) -> None:
    now = 1000.0
    monkeypatch.setattr(resolver, "time", SimpleNamespace(monotonic=lambda: now))
    made = Resolver(SimpleNamespace(call=lambda callback: callback()))  # type: ignore[arg-type]
    addresses = list[str]()
    for _ in range(2):
        made.resolve("one", addresses.append, pytest.fail)
    assert asked == ["one"]
    now += resolver.LIFETIME + 1.0
    made.resolve("two", addresses.append, pytest.fail)
    assert set(made._answers) == {"two"}
    made.resolve("one", addresses.append, pytest.fail)
    assert asked == ["one", "two", "one"]
    assert addresses == ["10.0.0.1"] * 4


def test_a_name_that_got_no_thread_fails_with_the_reason_and_is_looked_up_later(
    monkeypatch: pytest.MonkeyPatch, asked: list[str]
) -> None:
    monkeypatch.setattr(AtOnce, "refusals", 1)
    made = Resolver(SimpleNamespace(call=lambda callback: callback()))  # type: ignore[arg-type]
    reasons, addresses = list[str](), list[str]()
    made.resolve("one", addresses.append, reasons.append)
    assert reasons == ["the name one cannot be resolved: can't start new thread"]
    made.resolve("one", addresses.append, reasons.append)
    assert addresses == ["10.0.0.1"]
    assert asked == ["one"]
