"""Limits the wall time spent on rendering, so that physics keeps its pace."""

import time
from collections.abc import Callable

from pioneer_gazebo.nodes.pace import Pacer
from pioneer_node.nodes.standing_warning import StandingWarning

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
