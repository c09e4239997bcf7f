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


def _always() -> bool:
    return True


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Something that happens every ``period`` ticks, at whole multiples of it."""

    owner: str  #: what it is, for messages
    period: int  #: [ticks]
    action: Callable[[int], None]  #: gets the tick
    wanted: Callable[[], bool] = _always  #: whether anybody needs it at present
    needs_state: bool = True  #: whether it looks at the simulated world, or at the time only


class Schedule:
    """Tasks by their period. Tasks of one period run in the order they were added, shorter periods first.

    A task that nobody wants is as if it were not there: nothing wakes up for it.
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
        """Has ``action`` called at ``rate`` [Hz] while it is ``wanted``, which is asked at each `review` only.

        Raises:
            RateError: as `period_of`.
        """
        task = Task(owner, period_of(rate, owner), action, wanted, needs_state)
        self._tasks.append(task)
        self.review()
        return task

    def remove(self, task: Task) -> None:
        """Takes a task out."""
        self._tasks.remove(task)
        self.review()

    def review(self) -> None:
        """Has every task asked whether it is wanted, before anything else is answered. Any thread may call this."""
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
        """Returns the first tick after ``tick`` at which something is due; the next second where nothing ever is."""
        return min((tick - tick % period + period for period in self._by_period()), default=tick + TICK_RATE)

    def due(self, tick: int) -> list[Task]:
        """Returns all that is due at ``tick``, in the order it is to run in."""
        return [task for period, tasks in self._by_period().items() if tick % period == 0 for task in tasks]

    def run(self, tick: int) -> None:
        """Runs all that is due at ``tick``."""
        for task in self.due(tick):
            task.action(tick)
