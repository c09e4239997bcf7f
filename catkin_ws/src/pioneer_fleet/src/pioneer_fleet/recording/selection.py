"""Which recorded messages are played, and when: topics, start, simulated time."""

import fnmatch
import struct
from collections.abc import Iterable, Iterator, Sequence

from pioneer_fleet.recording.recording import Message

_CLOCK_TYPE = "rosgraph_msgs/Clock"
_SECOND = 10**9


def name_without_master(topic: str) -> str:
    """Returns a recorded topic's name in the fleet: ``/base/clock`` was ``/clock``."""
    return "/" + topic.lstrip("/").partition("/")[2]


def is_chosen(topic: str, patterns: Sequence[str]) -> bool:
    """Returns whether a recorded topic's name matches one of the patterns, or there is none.

    Args:
        topic: its name, beginning with its master's.
        patterns: shell patterns, in which ``*`` also matches ``/``, for names with the master's name or without.
    """
    if not patterns:
        return True
    names = (topic, name_without_master(topic))
    return any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns for name in names)


def chosen(messages: Iterable[Message], patterns: Sequence[str]) -> Iterator[Message]:
    """Yields the messages of topics that match one of the patterns; see `is_chosen`."""
    known: dict[str, bool] = {}
    for message in messages:
        topic = message.topic
        if topic not in known:
            known[topic] = is_chosen(topic, patterns)
        if known[topic]:
            yield message


def since(messages: Iterable[Message], offset: float) -> Iterator[Message]:
    """Yields the messages from a time on, preceded by what each sender had latched by then, with that time.

    Args:
        messages: in chronological order.
        offset: time after the first message [s].
    """
    begin: int | None = None
    latched: dict[tuple[str, str], Message] = {}
    for message in messages:
        if begin is None:
            begin = message.time + round(offset * _SECOND)
        if message.time >= begin:
            for one in latched.values():
                yield one._replace(time=begin)
            latched = {}
            yield message
        elif message.kind.latching:
            # The newest is the last one in the order of insertion.
            latched.pop((message.topic, message.kind.sender), None)
            latched[message.topic, message.kind.sender] = message


def in_simulated_time(messages: Iterable[Message]) -> Iterator[Message]:
    """Yields the messages with times that pass as on ``/clock``, not as the recording's wall clock did.

    Time stands until the first message on ``/clock``, and does not go back when the simulation was reset.
    """
    now: int | None = None
    last: int | None = None
    for message in messages:
        if now is None:
            now = message.time
        if is_clock(message):
            stamp = stamp_of(message)
            if last is not None:
                now += max(0, stamp - last)
            last = stamp
        yield message._replace(time=now)


def is_clock(message: Message) -> bool:
    """Returns whether it gives the simulated time."""
    is_named_so = name_without_master(message.topic) == "/clock"
    return is_named_so and message.kind.type == _CLOCK_TYPE and len(message.data) == 8


def stamp_of(clock: Message) -> int:
    """Returns the simulated time that a message on ``/clock`` gives [ns]."""
    seconds, nanoseconds = struct.unpack("<II", clock.data)
    return int(seconds) * _SECOND + int(nanoseconds)
