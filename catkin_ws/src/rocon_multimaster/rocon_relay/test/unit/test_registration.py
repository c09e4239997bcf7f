"""Registering a proxy at a master that answers in its own time."""

import random
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


class DrawnTimer:
    def __init__(self, call: Callable[[], object]) -> None:
        self.call: Callable[[], object] | None = call

    def cancel(self) -> None:
        self.call = None


class DrawnReactor:
    """Keeps timers until the test runs one of them."""

    def __init__(self) -> None:
        self.timers: list[DrawnTimer] = []

    def call_later(self, _delay: float, call: Callable[[], object]) -> DrawnTimer:
        self.timers.append(DrawnTimer(call))
        return self.timers[-1]

    def run_one(self, drawn: random.Random) -> bool:
        self.timers = [timer for timer in self.timers if timer.call is not None]
        if not self.timers:
            return False
        timer = self.timers.pop(drawn.randrange(len(self.timers)))
        assert timer.call is not None
        timer.call()
        return True


class DrawnMaster(FakeMaster):
    """Executes or loses each call, and then loses some answers."""

    def __init__(self, drawn: random.Random) -> None:
        super().__init__()
        self.is_registered = False
        self.registrations = 0
        self._drawn = drawn
        self._lost = 0

    def answer_one(self, is_faulty: bool) -> bool:
        """Handles the oldest call; returns False if there is none."""
        if not self.calls:
            return False
        method, registers = self.calls[0][0], self.calls[0][0] == "registerPublisher"
        fate = self._drawn.random() if is_faulty else 1.0
        # An unregistration is repeated only so often.
        if not registers and self._lost + 1 >= UNREGISTER_ATTEMPTS:
            fate = 1.0
        if fate < 0.15:
            self._lost += 1
            self.answer(NoAnswer("the call was lost"))
            return True
        if registers and fate < 0.3:
            self.answer("no")
            return True
        self.is_registered = registers
        self.registrations += registers
        is_lost = 0.3 <= fate < 0.45
        self._lost = self._lost + 1 if is_lost and not registers else 0
        assert self.answer(NoAnswer("the answer was lost") if is_lost else "") == method
        return True


class DrawnOwner(FakeOwner):
    registration: Registration

    def close_users(self) -> None:
        assert not self.registration.is_serving, "users are closed while it is served"


@pytest.mark.parametrize("first", range(0, 1000, 100))
def test_whatever_gets_lost_the_last_request_wins(first: int) -> None:
    for seed in range(first, first + 100):
        _play(random.Random(seed))


def _play(drawn: random.Random) -> None:
    context = FakeContext()
    master = context.master = DrawnMaster(drawn)
    reactor = context.reactor = DrawnReactor()  # type: ignore[assignment]
    owner = DrawnOwner()
    registration = owner.registration = Registration(context, FakeNodes(), owner)  # type: ignore[arg-type]
    is_shown, refreshed_at = False, -1

    def show() -> None:
        nonlocal is_shown
        is_shown = True
        registration.show()

    def hide() -> None:
        nonlocal is_shown
        is_shown = False
        registration.hide()

    def refresh() -> None:
        nonlocal refreshed_at
        refreshed_at = master.registrations
        registration.refresh()

    acts: list[Callable[[], object]] = [
        show,
        hide,
        refresh,
        lambda: master.answer_one(True),
        lambda: master.answer_one(True),
        lambda: reactor.run_one(drawn),
    ]
    for _ in range(drawn.randrange(1, 30)):
        drawn.choice(acts)()
        assert len(master.calls) <= 1, "one call at a time"
    while master.answer_one(False) or reactor.run_one(drawn):
        assert len(master.calls) <= 1, "one call at a time"
    assert (registration.is_serving, bool(owner.topics)) == (is_shown, is_shown)
    assert master.is_registered == is_shown
    if owner.told:
        assert (owner.told[-1] == "shown") == is_shown
    if is_shown:
        assert master.registrations > refreshed_at, "the master has notified all since the refresh"
