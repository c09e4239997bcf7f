"""Playback of recordings from any time and at any rate."""

import threading
from pathlib import Path

import pytest

from pioneer_fleet.recording.player import Pace
from pioneer_fleet.recording.recording import (
    Kind,
    McapFile,
    Message,
    RecordingError,
    contents,
    messages_since,
)

PLAIN, LATCHED = (
    Kind("std_msgs/Empty", "0", "", False),
    Kind("std_msgs/String", "1", "string data", True),
)
SECOND = 10**9


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Returns a recording with a map at 1 s, another one at 2 s, and clock messages at 1 to 4 s."""
    file = McapFile(tmp_path / "run.mcap")
    for second in range(1, 5):
        file.add(Message("/base/clock", PLAIN, second * SECOND, b"%d" % second))
        if second < 3:
            file.add(Message("/base/map", LATCHED, second * SECOND, b"map %d" % second))
    file.close()
    return tmp_path / "run.mcap"


def test_what_was_latched_before_comes_first(path: Path) -> None:
    found = [(one.topic, one.data) for one in messages_since(path, 3 * SECOND)]
    assert found == [("/base/map", b"map 2"), ("/base/clock", b"3"), ("/base/clock", b"4")]
    assert contents(path) == (SECOND, 4 * SECOND, ["/base/clock", "/base/map"])


def test_a_file_that_is_none_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"no recording at all")
    with pytest.raises(RecordingError, match="is not a complete MCAP file"):
        contents(tmp_path / "run.mcap")


def test_messages_are_due_at_the_rate_and_none_while_it_is_paused() -> None:
    pace = Pace(1000.0, threading.Event())
    pace.begin(SECOND)
    assert pace.waits_for(SECOND)
    assert pace.waits_for(11 * SECOND)
    assert pace.at >= 11 * SECOND
    pace.paused, stood = True, pace.at
    threading.Timer(0.3, setattr, (pace, "jump", 5 * SECOND)).start()
    assert not pace.waits_for(10**6 * SECOND)
    assert pace.at == stood
    pace.begin(5 * SECOND)
    assert pace.waits_for(4 * SECOND)
