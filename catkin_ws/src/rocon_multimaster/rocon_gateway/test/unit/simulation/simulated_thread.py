"""Threads that run one at a time in simulated time, so that a schedule with them is the same in each run."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol


class Clock(Protocol):
    """The simulation's list of events."""

    now: float

    def at(self, when: float, act: Callable[[], None]) -> None:
        """Calls `act` at this time."""


class ThreadKilledError(BaseException):
    """Ends a simulated thread, as the end of its process does; not an Exception, so that no loop survives it."""


class SimulatedThread:
    """Replaces `threading.Thread`: it runs only while the simulation waits for its next pause or end."""

    current: SimulatedThread | None = None
    """The thread that is running; None for the simulation itself."""

    def __init__(self, clock: Clock, target: Callable[[], object]) -> None:
        self.failure: BaseException | None = None  #: the exception that ended it
        self.is_over = False
        self._clock = clock
        self._target = target
        self._is_killed = False
        self._pauses = 0
        self._may_run = threading.Semaphore(0)
        self._has_paused = threading.Semaphore(0)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._is_started = False

    def start(self) -> None:
        """Starts the thread at the present time."""
        self._is_started = True
        self._thread.start()
        self._wake_at(self._clock.now)

    def join(self, timeout: float | None = None) -> None:
        """Returns at once: the simulation cannot wait."""

    def pause(self, seconds: float) -> None:
        """Lets simulated time pass; called by the thread itself. It may end earlier, by `nudge`."""
        self._wake_at(self._clock.now + seconds)
        self._has_paused.release()
        self._may_run.acquire()
        if self._is_killed:
            raise ThreadKilledError

    def nudge(self) -> None:
        """Ends the present pause now."""
        if not self.is_over:
            self._wake_at(self._clock.now)

    def kill(self) -> None:
        """Ends the thread at once, wherever it pauses."""
        self._is_killed = True
        if self._is_started and not self.is_over:
            self._resume()

    def _wake_at(self, when: float) -> None:
        pause = self._pauses

        def wake() -> None:
            if pause == self._pauses and not self.is_over:
                self._resume()

        self._clock.at(when, wake)

    def _resume(self) -> None:
        self._pauses += 1
        before, SimulatedThread.current = SimulatedThread.current, self
        self._may_run.release()
        self._has_paused.acquire()
        SimulatedThread.current = before
        if self.is_over:
            self._thread.join()

    def _run(self) -> None:
        self._may_run.acquire()
        try:
            if not self._is_killed:
                self._target()
        except ThreadKilledError:
            pass
        except BaseException as error:  # noqa: BLE001 - reported as a failure of the simulation
            self.failure = error
        self.is_over = True
        self._has_paused.release()
