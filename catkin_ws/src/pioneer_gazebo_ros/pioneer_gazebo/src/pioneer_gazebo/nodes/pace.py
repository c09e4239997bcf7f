"""Paces simulated time by wall time."""

import math
import time

MOST_BEHIND = 0.2
"""Maximum lag [s]; a simulator that is further behind does not catch up but continues from there."""


class Pacer:
    """Computes when simulated times are due, from an anchor at which both clocks were read."""

    def __init__(self, factor: float) -> None:
        """Takes the real-time factor; 0 for as fast as possible."""
        self.factor = factor
        self._anchor: tuple[float, float] | None = None
        self._excused = 0.0
        self._measured = (0.0, time.monotonic())

    def restart(self) -> None:
        """Sets a new anchor at the next time: after a pause, or after a change of the factor."""
        self._anchor = None

    def wait_for(self, simulated: float) -> float:
        """Returns how long [s] to wait until ``simulated`` [s] is due; 0 or less if it is due."""
        if self.factor <= 0:
            return 0.0
        now = time.monotonic()
        if self._anchor is None:
            self._anchor = simulated, now
        wait = self._anchor[1] + (simulated - self._anchor[0]) / self.factor - now
        if wait >= 0.0:
            self._excused = 0.0
        elif wait < -MOST_BEHIND - self._excused:
            self._anchor = simulated, now
            return 0.0
        return wait

    def excuse(self, seconds: float) -> None:
        """Increases the permitted lag by ``seconds`` until the simulator has caught up."""
        self._excused += seconds

    def reached(self) -> float:
        """Returns the simulated time [s] due now; infinity if time is not paced. Thread-safe."""
        anchor = self._anchor
        if self.factor <= 0 or anchor is None:
            return math.inf
        return anchor[0] + (time.monotonic() - anchor[1]) * self.factor

    def measured(self, simulated: float) -> float:
        """Returns the real-time factor since the last call."""
        now = time.monotonic()
        (then, wall), self._measured = self._measured, (simulated, now)
        return max(0.0, simulated - then) / max(1e-9, now - wall)

    @staticmethod
    def now() -> float:
        """Returns the wall clock [s] used by the simulator."""
        return time.monotonic()
