"""How much of the wall time pictures may take, so that physics keeps its pace."""

import time
from collections.abc import Callable

from pioneer_gazebo.nodes.pace import Pacer
from pioneer_node.nodes.standing_warning import StandingWarning

SHARE = 0.4
"""Of the wall time."""

SAVED = 0.5
"""Wall seconds of pictures that may be drawn at once after a rest."""

REPORT_PERIOD = 30.0
"""Pictures that are left out are reported at most once in so many wall seconds."""


class Budget:
    """Wall time for pictures; without limit where simulated time runs as fast as possible."""

    def __init__(self, pacer: Pacer) -> None:
        """Takes what paces simulated time, which may catch up with what pictures took."""
        self._pacer = pacer
        self._left = SAVED
        self._then = self._left_out = time.monotonic()
        self._late = StandingWarning("pictures are complete again", REPORT_PERIOD)

    def draw(self, name: str, picture: Callable[[], None]) -> bool:
        """Has a picture drawn if there is time for it; returns whether it was."""
        now = time.monotonic()
        self._left = min(SAVED, self._left + SHARE * (now - self._then))
        self._then = now
        if self._pacer.factor > 0 and self._left <= 0.0:
            self._left_out = now
            self._late.warn(
                f"{name}: pictures take more than {SHARE:.0%} of the time: some are left out so that physics keeps"
                " its pace; reduce the camera's size or rate"
            )
            return False
        if now - self._left_out > REPORT_PERIOD:
            self._late.end()
        picture()
        took = time.monotonic() - now
        self._left -= took
        self._pacer.excuse(took)
        return True
