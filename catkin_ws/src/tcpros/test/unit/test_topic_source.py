"""A subscription's publishers, and what is left of them once it has ended."""

import logging
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from tcpros.topic_source import TopicSource


class FakeContext:
    """Records the questions to publishers and the timers."""

    def __init__(self) -> None:
        self.asked: list[tuple[Callable[[Any], object], Callable[[str], object]]] = []
        self.timers: list[SimpleNamespace] = []
        self.logger = logging.getLogger("source")
        self.reactor = self
        self.resolver = SimpleNamespace(resolve=lambda _host, found, _failed: found("127.0.0.1"))

    def server(self, _uri: str) -> Any:
        """Returns the client of a publisher."""

        def call(_method: str, _arguments: object, done: Any, failed: Any) -> None:
            self.asked.append((done, failed))

        return SimpleNamespace(call=call)

    def call_later(self, _delay: float, _callback: Callable[[], object]) -> Any:
        """Returns a timer that never expires."""
        timer = SimpleNamespace(is_cancelled=False)
        timer.cancel = lambda: setattr(timer, "is_cancelled", True)
        self.timers.append(timer)
        return timer


@pytest.fixture
def context() -> FakeContext:
    return FakeContext()


@pytest.fixture
def source(context: FakeContext) -> TopicSource:
    fields = {"topic": "/words", "type": "std_msgs/String", "md5sum": "*"}
    made = TopicSource(context, "/one", fields, lambda *_: None)  # type: ignore[arg-type]
    made.update(["http://publisher/"])
    assert len(context.asked) == 1
    return made


def test_an_ended_subscription_does_not_wait_to_ask_again(
    context: FakeContext, source: TopicSource
) -> None:
    context.asked[0][1]("it is busy")
    assert [timer.is_cancelled for timer in context.timers] == [False]
    source.close()
    assert [timer.is_cancelled for timer in context.timers] == [True]


def test_an_answer_after_the_end_of_a_subscription_changes_nothing(
    context: FakeContext, source: TopicSource
) -> None:
    source.close()
    context.asked[0][1]("it is busy")
    context.asked[0][0](["TCPROS", "publisher", 1])
    source.update(["http://another/"])
    assert context.timers == []
    assert len(context.asked) == 1
    assert source.publisher_names == []
