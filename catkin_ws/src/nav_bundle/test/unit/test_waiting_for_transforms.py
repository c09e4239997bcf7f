"""Waiting for a transform: how long, for which of several frames, and when waiting cannot help."""

import threading
import time
from collections.abc import Callable

import pytest
import rospy

from nav_bundle.base.topics import TransformListener
from nav_bundle.base.transform import (
    DisconnectedError,
    ExtrapolationError,
    FrameNameError,
    Transform,
    TransformError,
)

FOUND = Transform((1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
PATIENCE = 0.4


class Tree:
    """What ``wait_for_any`` needs of the listener, with answers of the test's own."""

    def __init__(self, answer: Callable[[str], Transform]) -> None:
        self.arrived = threading.Condition()
        self._answer = answer

    def lookup(self, _target: str, source: str, _stamp: float | None) -> Transform:
        return self._answer(source)

    def watch(self) -> None:
        pass

    def wait(self, *sources: str) -> Transform:
        return TransformListener.wait_for_any(self, "map", sources, None, PATIENCE)  # type: ignore[arg-type]


@pytest.fixture(autouse=True)
def _running(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)


def raising(error: TransformError) -> Callable[[str], Transform]:
    def answer(_: str) -> Transform:
        raise error

    return answer


def test_two_names_of_a_frame_share_one_time_limit() -> None:
    tree = Tree(raising(DisconnectedError("not connected")))
    began = time.monotonic()
    with pytest.raises(DisconnectedError):
        tree.wait("pioneer1/ghost", "ghost")
    assert PATIENCE <= time.monotonic() - began < 2 * PATIENCE


@pytest.mark.parametrize("error", [ExtrapolationError("too old", False), FrameNameError("a NUL")])
def test_nothing_waits_for_what_no_message_can_bring(error: TransformError) -> None:
    began = time.monotonic()
    with pytest.raises(type(error)):
        Tree(raising(error)).wait("pioneer1/ghost", "ghost")
    assert time.monotonic() - began < PATIENCE


def test_the_frame_that_exists_is_taken_whichever_its_place() -> None:
    def answer(source: str) -> Transform:
        if source == "ghost":
            return FOUND
        raise DisconnectedError(source)

    assert Tree(answer).wait("pioneer1/ghost", "ghost") == FOUND
    assert Tree(answer).wait("ghost", "pioneer1/ghost") == FOUND


def test_a_transform_that_arrives_meanwhile_ends_the_wait() -> None:
    known: list[str] = []

    def answer(source: str) -> Transform:
        if source in known:
            return FOUND
        raise DisconnectedError(source)

    tree = Tree(answer)

    def arrive() -> None:
        with tree.arrived:
            known.append("ghost")
            tree.arrived.notify_all()

    threading.Timer(0.05, arrive).start()
    assert tree.wait("pioneer1/ghost", "ghost") == FOUND


def test_the_reason_is_that_of_the_first_name() -> None:
    def answer(source: str) -> Transform:
        raise DisconnectedError(source)

    with pytest.raises(DisconnectedError, match="pioneer1/ghost"):
        Tree(answer).wait("pioneer1/ghost", "ghost")
