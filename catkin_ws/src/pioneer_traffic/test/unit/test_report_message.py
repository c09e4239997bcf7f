"""Reports survive the conversion to and from messages; messages that fit no roadmap are refused."""

import math

import genpy
import pytest
from nav_bundle.msg import NavigationState

from pioneer_traffic.conversions import (
    message_from_report,
    message_from_status,
    report_from_message,
)
from pioneer_traffic.event import Condition, Status
from pioneer_traffic.report import Plan, PlanId, Report, Wait

PLAN = Plan(
    PlanId(4, "a"),
    {"a": (1,), "b": (2, 3)},
    {"a": (1, 5), "b": (3,)},
    {"b": (7, 900)},
    (Wait("a", 1, "b", 1),),
)
REPORT = Report(
    "a", 77, (1.0, -2.0), (1, 5), 5, 12.5, (7,), True, PLAN.id, 1, PLAN.id, ("b",), PLAN
)


@pytest.mark.parametrize("report", [REPORT, Report("b", 77, (0.0, 0.0))], ids=["full", "empty"])
def test_a_report_comes_back_as_it_was(report: Report) -> None:
    assert report_from_message(message_from_report(report, genpy.Time(3)), 77, 10) == report


@pytest.mark.parametrize("places", [5, 4])
def test_a_report_of_places_that_do_not_exist_is_refused(places: int) -> None:
    assert report_from_message(message_from_report(REPORT, genpy.Time(3)), 77, places) is None


def test_a_plan_with_a_robot_that_holds_nothing_is_refused() -> None:
    message = message_from_report(REPORT, genpy.Time(3))
    message.plan.paths[0].held = ()
    assert report_from_message(message, 77, 10) is None


def test_a_report_of_another_larger_roadmap_is_taken() -> None:
    """It used to be dropped, so that its robot was not driven around."""
    report = report_from_message(message_from_report(REPORT, genpy.Time(3)), 78, 2)
    assert report is not None
    assert report.position == REPORT.position


def test_a_report_without_a_position_is_refused() -> None:
    message = message_from_report(REPORT, genpy.Time(3))
    message.position.x = math.nan
    assert report_from_message(message, 77, 10) is None


@pytest.mark.parametrize("condition", Condition)
def test_every_status_has_a_state(condition: Condition) -> None:
    status = Status(condition, "waits for b, c", ("b", "c"))
    message = message_from_status(status, genpy.Time(3))
    assert message.text == f"{condition.value}: waits for b, c"
    assert message.state == getattr(NavigationState, condition.name)
    assert (message.robot, message.reason) == ("b", NavigationState.WAY_BLOCKED)
    assert message_from_status(Status(condition), genpy.Time(3)).text == condition.value
