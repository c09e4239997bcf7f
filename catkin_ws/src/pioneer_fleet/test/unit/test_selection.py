"""Which recorded messages are played, and when."""

import struct

import pytest

from pioneer_fleet.recording.recording import Kind, Message
from pioneer_fleet.recording.selection import chosen, in_simulated_time, is_chosen, since

SECOND = 10**9
WORDS = Kind("std_msgs/String", "0", "", False, "/one")
MAP = Kind("nav_msgs/OccupancyGrid", "1", "", True, "/map_server")
CLOCK = Kind("rosgraph_msgs/Clock", "2", "", False, "/gazebo")


def word(seconds: float, text: bytes = b"") -> Message:
    return Message("/aadi1/words", WORDS, round(seconds * SECOND), text)


def latched(seconds: float, sender: str, text: bytes) -> Message:
    kind = MAP._replace(sender=sender)
    return Message("/base/tf_static", kind, round(seconds * SECOND), text)


def clock(seconds: float, simulated: float) -> Message:
    whole, part = divmod(round(simulated * SECOND), SECOND)
    data = struct.pack("<II", whole, part)
    return Message("/base/clock", CLOCK, round(seconds * SECOND), data)


@pytest.mark.parametrize(
    ("patterns", "expected"),
    [
        ([], True),
        (["/pioneer1/odom"], True),
        (["/base/pioneer1/odom"], True),
        (["/pioneer*"], True),
        (["/base/*"], True),
        (["*/odom"], True),
        (["/aadi1/*"], False),
        (["/clock", "/tf*"], False),
        (["/odom"], False),
    ],
)
def test_a_pattern_fits_a_topic_with_or_without_its_masters_name(
    patterns: list[str], expected: bool
) -> None:
    assert is_chosen("/base/pioneer1/odom", patterns) == expected


def test_a_start_later_brings_what_each_sender_had_latched_by_then() -> None:
    messages = [
        latched(10, "/one", b"old"),
        latched(11, "/two", b"other"),
        word(12),
        latched(13, "/one", b"new"),
        word(15, b"first"),
        latched(16, "/one", b"later"),
    ]
    assert list(since(messages, 4.0)) == [
        latched(14, "/two", b"other"),
        latched(14, "/one", b"new"),
        word(15, b"first"),
        latched(16, "/one", b"later"),
    ]
    assert list(since(messages, 0.0)) == messages
    assert list(since(messages, 100.0)) == []


def test_in_simulated_time_messages_pass_as_the_clock_does() -> None:
    """The recorded simulator had a real-time factor of 0.5, and was reset at last."""
    messages = [word(100), clock(101, 7.0), word(102), clock(103, 8.0), clock(104, 0.0), word(105)]
    times = [one.time / SECOND for one in in_simulated_time([*messages, clock(106, 1.0)])]
    assert times == [100, 100, 100, 101, 101, 101, 102]


def test_only_chosen_topics_are_played() -> None:
    messages = [word(1), clock(2, 1.0), word(3)]
    assert list(chosen(messages, ["/words"])) == [word(1), word(3)]
