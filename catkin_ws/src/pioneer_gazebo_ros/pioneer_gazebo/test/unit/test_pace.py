"""Physics keeps its pace even if cameras request more pictures than the machine can draw."""

import logging
from collections.abc import Callable

import pytest

from pioneer_gazebo.timeline import Budget, Pacer

STEP, STEP_COST = 0.02, 0.002
"""Simulated time per step, and its cost in wall time [s]."""


class Clock:
    """A fake wall clock that advances only by the cost of simulated work."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr("time.monotonic", clock.monotonic)
    return clock


def run(clock: Clock, pacer: Pacer, seconds: float, each_step: Callable[[], object]) -> float:
    """Runs for ``seconds`` of wall time; returns the real-time factor."""
    simulated, end, began = 0.0, clock.now + seconds, clock.now
    while clock.now < end:
        clock.now += max(0.0, pacer.wait_for(simulated))
        clock.now += STEP_COST
        each_step()
        simulated += STEP
    return simulated / (clock.now - began)


@pytest.mark.parametrize("cost", [0.01, 0.1, 0.5, 2.0])
def test_pictures_of_any_cost_leave_physics_their_pace(
    clock: Clock, caplog: pytest.LogCaptureFixture, cost: float
) -> None:
    pacer = Pacer(1.0)
    drawn = Budget(pacer)
    pictures = 0

    def picture() -> None:
        nonlocal pictures
        pictures += 1
        clock.now += cost

    with caplog.at_level(logging.WARNING):
        factor = run(clock, pacer, 60.0, lambda: drawn.draw("r/camera", picture))
    assert factor == pytest.approx(1.0, abs=0.04)
    wanted = 60.0 / STEP
    assert pictures >= 0.3 * min(60.0 / cost, wanted)
    skipped = pictures < 0.9 * wanted
    assert len([one for one in caplog.records if "dropping images" in one.message]) == (
        2 if skipped else 0
    )


def test_as_fast_as_possible_every_picture_is_drawn(clock: Clock) -> None:
    drawn = Budget(Pacer(0.0))
    assert all(
        drawn.draw("r/camera", lambda: setattr(clock, "now", clock.now + 3.0)) for _ in range(10)
    )


def test_a_simulator_that_was_held_up_by_something_else_does_not_catch_up(clock: Clock) -> None:
    pacer = Pacer(1.0)
    pacer.wait_for(0.0)
    clock.now += 5.0
    pacer.wait_for(STEP)
    assert pacer.wait_for(2 * STEP) == pytest.approx(STEP)
