"""When the cause of a repeated warning ends, one line is logged."""

import logging
from collections.abc import Callable

import pytest

from pioneer_node.nodes.standing_warning import StandingWarning


@pytest.fixture
def lines(caplog: pytest.LogCaptureFixture) -> Callable[[], list[str]]:
    """Returns a function that lists what rospy's logger has logged."""
    caplog.set_level(logging.INFO, "rosout")
    return lambda: [f"{one.levelname.lower()}: {one.getMessage()}" for one in caplog.records]


def test_a_warning_repeats_once_a_period_and_its_end_is_one_line(
    lines: Callable[[], list[str]],
) -> None:
    warning = StandingWarning("scans are used again", period=0.0)
    warning.end()
    assert lines() == [], "nothing was wrong"
    warning.warn("no transform")
    warning.warn("no transform")
    warning.end()
    warning.end()
    assert lines() == [
        "warning: no transform",
        "warning: no transform",
        "info: scans are used again",
    ]


def test_a_condition_that_flickers_logs_one_pair_of_lines_a_period(
    lines: Callable[[], list[str]],
) -> None:
    warning = StandingWarning("scans are used again", period=60.0)
    for _ in range(5):
        warning.warn("no transform")
        warning.end()
    assert lines() == ["warning: no transform", "info: scans are used again"]
