"""Warnings that end are followed by one line."""

import pytest
import rospy

from pioneer_node.nodes.standing_warning import StandingWarning


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is logged."""
    found: list[str] = []
    monkeypatch.setattr(rospy, "logwarn", lambda form, text: found.append(f"warning: {form % text}"))
    monkeypatch.setattr(rospy, "loginfo", lambda form, text: found.append(f"info: {form % text}"))
    return found


def test_a_warning_repeats_once_a_period_and_its_end_is_one_line(lines: list[str]) -> None:
    warning = StandingWarning("scans are used again", period=0.0)
    warning.end()
    assert lines == [], "nothing was wrong"
    warning.warn("no transform")
    warning.warn("no transform")
    warning.end()
    warning.end()
    assert lines == ["warning: no transform", "warning: no transform", "info: scans are used again"]


def test_a_condition_that_flickers_logs_one_pair_of_lines_a_period(lines: list[str]) -> None:
    warning = StandingWarning("scans are used again", period=60.0)
    for _ in range(5):
        warning.warn("no transform")
        warning.end()
    assert lines == ["warning: no transform", "info: scans are used again"]
