"""Simulated time against wall time."""

import math
import time

MOST_BEHIND = 0.2
"""A simulator that is further behind [s] gives up catching up and continues from there."""


class Pacer:
    """Says when a moment of simulated time is due, from an anchor where both clocks were read together."""

    def __init__(self, factor: float) -> None:
        """Takes the real-time factor; 0 is as fast as possible."""
        self.factor = factor
        self._anchor: tuple[float, float] | None = None
        self._excused = 0.0
        self._measured = (0.0, time.monotonic())

    def restart(self) -> None:
        """Anchors again at the next moment: after a pause, or when the factor changed."""
        self._anchor = None

    def wait_for(self, simulated: float) -> float:
        """Returns how long [s] to wait until the moment ``simulated`` [s] is due; 0 or less: it is."""
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
        """Lets the simulator be behind by so much more [s] until it has caught up."""
        self._excused += seconds

    def reached(self) -> float:
        """Returns the simulated time [s] that is due by now; infinity where none is kept to. Any thread may ask."""
        anchor = self._anchor
        if self.factor <= 0 or anchor is None:
            return math.inf
        return anchor[0] + (time.monotonic() - anchor[1]) * self.factor

    def measured(self, simulated: float) -> float:
        """Returns the real-time factor since this was asked last."""
        now = time.monotonic()
        (then, wall), self._measured = self._measured, (simulated, now)
        return max(0.0, simulated - then) / max(1e-9, now - wall)

    @staticmethod
    def now() -> float:
        """Returns the wall clock [s] that everything here is measured by."""
        return time.monotonic()
