"""A fault of a robot is one alert while it lasts, in its newest words."""

import pytest

from pioneer_web.state.alerts import Alerts

NEAR = "blocked: the way is blocked near ({:.1f}, 2.0)"
OCCUPIED = "failed: the goal is occupied by {}"


def shown(alerts: Alerts) -> list[tuple[object, object]]:
    return [(alert["what"], alert["until"]) for alert in alerts.values()]


@pytest.mark.parametrize(
    "texts",
    [[NEAR.format(x) for x in (0.1, -0.1, 7.1)], ["no scan for 3 s", "no scan for 14 s"]],
    ids=["places", "ages"],
)
def test_places_and_ages_that_change_renew_the_words_of_one_alert(texts: list[str]) -> None:
    alerts = Alerts()
    for now, text in enumerate(texts):
        alerts.update("pioneer1", text, float(now))
    assert shown(alerts) == [(texts[-1], None)]


def test_another_robot_in_the_way_is_another_alert() -> None:
    alerts = Alerts()
    for now, other in enumerate(("pioneer2", "pioneer3")):
        alerts.update("pioneer1", OCCUPIED.format(other), float(now))
    assert shown(alerts) == [
        (OCCUPIED.format("pioneer2"), 1.0),
        (OCCUPIED.format("pioneer3"), None),
    ]


def test_an_alert_that_has_not_changed_costs_nothing() -> None:
    alerts = Alerts()
    alerts.update("pioneer1", "no scan for 3 s", 0.0)
    before = alerts.values()
    alerts.update("pioneer1", "no scan for 3 s", 1.0)
    assert alerts.values() is before
