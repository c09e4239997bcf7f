"""When things happen: ticks of simulated time, and what is due at each."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from pioneer_gazebo.core.error import SimulatorError

TICK_RATE = 600
"""Ticks a simulated second. Every rate has to divide it: 10, 15, 20, 24, 25, 30, 40, 50, 60, 75, 100, 120 … Hz do."""

NANOSECONDS = 1_000_000_000


class RateError(SimulatorError):
    """A rate that is not a whole part of the tick rate."""


def period_of(rate: float, what: str) -> int:
    """Returns how many ticks lie between two events of ``rate`` [Hz].

    Raises:
        RateError: the rate does not divide the tick rate; the message names both.
    """
    if not (math.isfinite(rate) and 0 < rate <= TICK_RATE):
        raise RateError(f"{what}: a rate of {rate:g} Hz is not between 0 and {TICK_RATE} Hz")
    period = round(TICK_RATE / rate)
    if abs(period * rate - TICK_RATE) > 1e-6 * TICK_RATE:
        nearest = TICK_RATE / period
        raise RateError(
            f"{what}: a rate of {rate:g} Hz does not divide the simulator's {TICK_RATE} Hz; {nearest:g} Hz would"
        )
    return period


def nanoseconds(tick: int) -> int:
    """Returns the simulated time of a tick [ns]."""
    return tick * NANOSECONDS // TICK_RATE


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Something that happens every ``period`` ticks, at whole multiples of it; ``action`` gets the tick."""

    owner: str
    period: int
    action: Callable[[int], None]


class Schedule:
    """Tasks by their period. Tasks of one period run in the order they were added, shorter periods first."""

    def __init__(self) -> None:
        self._tasks: dict[int, list[Task]] = {}

    def add(self, owner: str, rate: float, action: Callable[[int], None]) -> Task:
        """Has ``action`` called at ``rate`` [Hz].

        Raises:
            RateError: as `period_of`.
        """
        task = Task(owner, period_of(rate, owner), action)
        self._tasks.setdefault(task.period, []).append(task)
        self._tasks = dict(sorted(self._tasks.items()))
        return task

    def remove(self, task: Task) -> None:
        """Takes a task out."""
        tasks = self._tasks[task.period]
        tasks.remove(task)
        if not tasks:
            del self._tasks[task.period]

    def next_after(self, tick: int) -> int:
        """Returns the first tick after ``tick`` at which something is due; the next second where nothing ever is."""
        return min((tick - tick % period + period for period in self._tasks), default=tick + TICK_RATE)

    def run(self, tick: int) -> None:
        """Runs all that is due at ``tick``."""
        for period, tasks in list(self._tasks.items()):
            if tick % period == 0:
                for task in list(tasks):
                    task.action(tick)
