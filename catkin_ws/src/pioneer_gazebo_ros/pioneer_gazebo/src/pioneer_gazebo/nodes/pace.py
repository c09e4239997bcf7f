"""Paces simulated time by wall time."""

import math
import time
from collections.abc import Callable

from pioneer_node.nodes.standing_warning import StandingWarning

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


SHARE = 0.4
"""Maximum share of wall time for rendering."""

SAVED = 0.5
"""Maximum wall time [s] that can be saved up for rendering."""

REPORT_PERIOD = 30.0
"""Minimum interval between reports about dropped images [s of wall time]."""


class Budget:
    """The wall time budget for images; unlimited if simulated time runs as fast as possible."""

    def __init__(self, pacer: Pacer) -> None:
        """Takes the pacer of simulated time, which may catch up the time spent on rendering."""
        self._pacer = pacer
        self._left = SAVED
        self._then = self._left_out = time.monotonic()
        self._late = StandingWarning("pictures are complete again", REPORT_PERIOD)

    def draw(self, name: str, picture: Callable[[], None]) -> bool:
        """Renders an image if the budget allows it; returns whether it did."""
        now = time.monotonic()
        self._left = min(SAVED, self._left + SHARE * (now - self._then))
        self._then = now
        if self._pacer.factor > 0 and self._left <= 0.0:
            self._left_out = now
            self._late.warn(
                f"{name}: rendering exceeds {SHARE:.0%} of the time; dropping images so that physics keeps its pace;"
                " reduce the camera's size or rate"
            )
            return False
        if now - self._left_out > REPORT_PERIOD:
            self._late.end()
        picture()
        took = time.monotonic() - now
        self._left -= took
        self._pacer.excuse(took)
        return True
