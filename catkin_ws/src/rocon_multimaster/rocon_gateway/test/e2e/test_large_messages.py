"""Messages of tens of megabytes cross; one above the limit closes its connection, and the log says why."""

import pytest
from measure import MB, checked

from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


def test_messages_of_60_mb_cross_whole(standing_fleet, standing) -> None:
    base, robot = standing
    robot.probe("load", "source", "/huge", 60 * MB, 1)
    log = standing_fleet.folder / "huge.log"
    base.probe("check", "sink", "/huge", log=log)
    assert base.flip("robot", "subscriber", "/huge") == 0
    wait_until(lambda: log.exists() and len(checked(log)) >= 2, "two messages", 60)
    assert all(good for *_, good in checked(log))


def test_a_message_above_the_limit_is_refused_with_a_line(standing_fleet, standing) -> None:
    base, robot = standing
    robot.probe("load", "source", "/too_large", 300 * MB, 0.2)
    log = standing_fleet.folder / "too_large.log"
    base.probe("check", "sink", "/too_large", log=log)
    assert base.flip("robot", "subscriber", "/too_large") == 0
    wait_until(
        lambda: "is longer than 268435456" in robot.log.read_text(), "a line with the reason", 60
    )
    assert not checked(log)
