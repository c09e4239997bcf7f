"""Registering a proxy at a master that answers in its own time."""

from collections.abc import Callable
from typing import Any

import pytest

from rocon_relay.connection import ANY, Address, Import
from rocon_relay.standing_import import UNREGISTER_ATTEMPTS, Registration
from tcpros.xmlrpc_client import NoAnswer


class FakeMaster:
    """Keeps calls until the test answers them."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, Callable[[Any], object], Callable[[str], object]]] = []

    def call(
        self,
        method: str,
        _arguments: tuple[str, ...],
        done: Callable[[Any], object],
        failed: Callable[[str], object],
    ) -> None:
        self.calls.append((method, done, failed))

    def answer(self, reason: str = "") -> str:
        """Answers the oldest call, with an error if a reason is given; returns its method."""
        method, done, failed = self.calls.pop(0)
        if reason:
            failed(reason)
        else:
            done(0)
        return method


class FakePause:
    def take(self) -> float:
        return 0.1

    def reset(self) -> None:
        """Does nothing."""


class FakeReactor:
    def __init__(self) -> None:
        self.timers: list[Callable[[], object]] = []

    def call_later(self, _delay: float, call: Callable[[], object]) -> "FakeReactor":
        self.timers.append(call)
        return self

    def cancel(self) -> None:
        self.timers.clear()


class FakeContext:
    def __init__(self) -> None:
        self.master, self.reactor = FakeMaster(), FakeReactor()

    def pause(self) -> FakePause:
        return FakePause()


class FakeNodes:
    def open(self, _name: str) -> object:
        return object()

    def close_unused(self, _node: object) -> None:
        """Does nothing."""


class FakeOwner:
    """An import that records what it receives."""

    wanted = Import("/words", ANY, ANY, "source", "/talker", Address("127.0.0.1", 1))

    def __init__(self) -> None:
        self.told: list[str] = []
        self.topics: dict[str, object] = {}

    def offered_by(self, _node: object) -> dict[str, object]:
        return self.topics

    def registering(self, _node: object) -> tuple[str, tuple[str, ...]]:
        return "registerPublisher", ()

    def unregistering(self, _node: object) -> tuple[str, tuple[str, ...]]:
        return "unregisterPublisher", ()

    def close_users(self) -> None:
        """Does nothing."""

    def shown(self) -> None:
        self.told.append("shown")

    def not_shown(self, _reason: str) -> None:
        self.told.append("not shown")

    def hidden(self) -> None:
        self.told.append("hidden")


@pytest.fixture
def context() -> FakeContext:
    return FakeContext()


@pytest.fixture
def registration(context: FakeContext) -> Registration:
    return Registration(context, FakeNodes(), FakeOwner())  # type: ignore[arg-type]


def test_a_refresh_during_a_registration_is_made_once_it_is_answered(
    context: FakeContext, registration: Registration
) -> None:
    """A subscriber that was refused before was never notified that it may subscribe now."""
    registration.show()
    registration.refresh()
    registration.refresh()
    assert len(context.master.calls) == 1
    assert context.master.answer() == "registerPublisher"
    assert context.master.answer() == "registerPublisher"
    assert not context.master.calls


def test_a_refresh_during_a_registration_that_fails_is_its_retry(
    context: FakeContext, registration: Registration
) -> None:
    registration.show()
    registration.refresh()
    context.master.answer("no")
    context.reactor.timers.pop()()
    assert context.master.answer() == "registerPublisher"
    assert not context.master.calls


def test_a_registration_that_shall_end_is_not_refreshed(
    context: FakeContext, registration: Registration
) -> None:
    registration.show()
    registration.refresh()
    registration.hide()
    assert context.master.answer() == "registerPublisher"
    assert context.master.answer() == "unregisterPublisher"
    assert not context.master.calls


def test_an_unregistration_without_an_answer_is_repeated_some_times(
    context: FakeContext, registration: Registration
) -> None:
    """The master's answer or the call itself was lost, and a dead proxy stayed registered."""
    registration.show()
    context.master.answer()
    registration.hide()
    context.reactor.timers.clear()
    for _ in range(UNREGISTER_ATTEMPTS - 1):
        assert context.master.answer(NoAnswer("lost")) == "unregisterPublisher"
        assert not context.master.calls
        context.reactor.timers.pop()()
    assert context.master.answer(NoAnswer("lost")) == "unregisterPublisher"
    assert not context.reactor.timers
    assert not context.master.calls


def test_a_refused_unregistration_is_not_repeated(
    context: FakeContext, registration: Registration
) -> None:
    registration.show()
    context.master.answer()
    registration.hide()
    context.reactor.timers.clear()
    context.master.answer("it is not registered")
    assert not context.reactor.timers
    assert not context.master.calls
