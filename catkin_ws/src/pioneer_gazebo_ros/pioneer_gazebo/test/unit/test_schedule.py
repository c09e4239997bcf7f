"""Ticks: which tasks are due when, and rates that do not divide the tick rate."""

import pytest

from pioneer_gazebo.simulation.schedule import (
    TICK_RATE,
    RateError,
    Schedule,
    nanoseconds,
    nearest_rate,
    period_of,
)


def run(schedule: Schedule, tick: int) -> None:
    for task in schedule.due(tick):
        task.action(tick)


def test_a_rate_that_divides_the_tick_rate_has_a_whole_period() -> None:
    assert period_of(40.0, "laser") * 40 == TICK_RATE


def test_a_rate_that_does_not_divide_is_refused_with_both_numbers() -> None:
    with pytest.raises(
        RateError, match=r"laser: a rate of 33 Hz does not divide the simulator's 600 Hz"
    ):
        period_of(33.0, "laser")


@pytest.mark.parametrize("rate", [1e-4, 0.3, 7.0, 33.0, 40.0, 333.0, 450.0, 599.0, 1000.0])
def test_the_nearest_rate_divides_the_tick_rate(rate: float) -> None:
    found = nearest_rate(rate)
    period_of(found, "laser")
    period = round(TICK_RATE / found)
    neighbours = [TICK_RATE / other for other in (period - 1, period + 1) if other]
    assert all(abs(found - rate) <= abs(other - rate) for other in neighbours)


@pytest.mark.parametrize("rate", [0.0, -1.0, 601.0, float("nan"), float("inf")])
def test_a_rate_that_makes_no_sense_is_refused(rate: float) -> None:
    with pytest.raises(RateError):
        period_of(rate, "laser")


def test_every_task_runs_at_its_rate_and_no_tick_is_visited_for_nothing() -> None:
    schedule, ran = Schedule(), []
    schedule.add("clock", 100.0, lambda tick: ran.append(("clock", tick)))
    schedule.add("laser", 40.0, lambda tick: ran.append(("laser", tick)))
    tick, visits = 0, 0
    while (tick := schedule.next_after(tick)) <= TICK_RATE:
        run(schedule, tick)
        visits += 1
    assert sum(name == "clock" for name, _ in ran) == 100
    assert sum(name == "laser" for name, _ in ran) == 40
    assert visits == len({tick for _, tick in ran})


def test_a_task_that_was_removed_does_not_run() -> None:
    schedule, ran = Schedule(), []
    task = schedule.add("clock", 100.0, ran.append)
    schedule.remove(task)
    run(schedule, TICK_RATE)
    assert ran == []


def test_a_task_may_remove_itself_while_it_runs() -> None:
    schedule, ran = Schedule(), []

    def once(tick: int) -> None:
        ran.append(tick)
        schedule.remove(task)

    task = schedule.add("once", 100.0, once)
    run(schedule, 6)
    run(schedule, 12)
    assert ran == [6]


def test_a_second_of_ticks_is_a_second() -> None:
    assert nanoseconds(TICK_RATE) == 1_000_000_000
    assert nanoseconds(6) == 10_000_000


def test_nothing_wakes_up_for_what_nobody_wants() -> None:
    schedule, ran, wanted = Schedule(), [], [False]
    schedule.add("laser", 10.0, ran.append)
    schedule.add("odometry", 50.0, ran.append, lambda: wanted[0])
    assert schedule.next_after(0) == 60
    wanted[0] = True
    assert schedule.next_after(0) == 60, "tasks are asked at a review only"
    schedule.review()
    assert schedule.next_after(0) == 12
    run(schedule, 12)
    assert ran == [12]
