"""Schedules periodic tasks in ticks of simulated time."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from pioneer_gazebo.error import SimulatorError

TICK_RATE = 600
"""Ticks per simulated second. Every rate must divide it, such as 10, 20, 24, 25, 30, 40, 50, 60, 75, 100, 120 Hz."""

NANOSECONDS = 1_000_000_000


class RateError(SimulatorError):
    """A rate does not divide the tick rate."""


def period_of(rate: float, what: str) -> int:
    """Returns the period of ``rate`` [Hz] in ticks.

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


def nearest_rate(rate: float) -> float:
    """Returns the rate nearest to ``rate`` [Hz] that divides the tick rate."""
    if not rate > 0:
        raise RateError(f"a rate must be above 0 Hz, not {rate:g} Hz")
    slower = math.ceil(TICK_RATE / rate) if rate > 1e-6 else TICK_RATE * 1_000_000
    rates = [TICK_RATE / max(1, period) for period in (slower - 1, slower)]
    return min(rates, key=lambda possible: abs(possible - rate))


def nearest_step(step: float) -> float:
    """Returns the multiple of a tick nearest to ``step`` [s], one tick at least."""
    return max(1, round(step * TICK_RATE)) / TICK_RATE


def nanoseconds(tick: int) -> int:
    """Returns the simulated time of a tick [ns]."""
    return tick * NANOSECONDS // TICK_RATE


def _always() -> bool:
    return True


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A periodic task, run at multiples of ``period`` ticks."""

    period: int  #: [ticks]
    action: Callable[[int], None]  #: called with the tick
    wanted: Callable[[], bool] = _always  #: returns whether the task is needed at present
    needs_state: bool = True  #: whether it reads the simulated world, or only the time


class Schedule:
    """Tasks by their period. Shorter periods run first, tasks of one period in the order they were added.

    A task that is not wanted is ignored, also by `next_after`.
    """

    def __init__(self) -> None:
        self._tasks: list[Task] = []
        self._wanted: dict[int, list[Task]] = {}
        self._stale = False

    def add(
        self,
        owner: str,
        rate: float,
        action: Callable[[int], None],
        wanted: Callable[[], bool] = _always,
        needs_state: bool = True,
    ) -> Task:
        """Calls ``action`` at ``rate`` [Hz] while ``wanted`` returns true; this is only checked after a `review`.

        Raises:
            RateError: the rate does not divide the tick rate; the message begins with ``owner``.
        """
        task = Task(period_of(rate, owner), action, wanted, needs_state)
        self._tasks.append(task)
        self.review()
        return task

    def remove(self, task: Task) -> None:
        """Removes a task."""
        self._tasks.remove(task)
        self.review()

    def review(self) -> None:
        """Makes the schedule check again which tasks are wanted, before its next answer. Thread-safe."""
        self._stale = True

    def _by_period(self) -> dict[int, list[Task]]:
        if self._stale:
            self._stale = False
            wanted: dict[int, list[Task]] = {}
            for task in self._tasks:
                if task.wanted():
                    wanted.setdefault(task.period, []).append(task)
            self._wanted = dict(sorted(wanted.items()))
        return self._wanted

    def next_after(self, tick: int) -> int:
        """Returns the first tick after ``tick`` at which a task is due; one second later if there are no tasks."""
        return min(
            (tick - tick % period + period for period in self._by_period()),
            default=tick + TICK_RATE,
        )

    def due(self, tick: int) -> list[Task]:
        """Returns all tasks due at ``tick``, in execution order."""
        return [
            task
            for period, tasks in self._by_period().items()
            if tick % period == 0
            for task in tasks
        ]
