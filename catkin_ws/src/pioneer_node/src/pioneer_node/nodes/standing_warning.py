"""Warnings that repeat while their cause lasts, and say when it has ended."""

import math
import time

import rospy

_PERIOD = 5.0
"""Least time between two lines of one warning [s of wall time]."""


class StandingWarning:
    """One condition of a node that should not last.

    Threads: to be used from one thread.

    Args:
        ended: what to log once when the condition has ended, if a warning was logged.
        period: least time between two warnings [s].
    """

    def __init__(self, ended: str, period: float = _PERIOD) -> None:
        self._ended, self._period = ended, period
        self._warned, self._stands = -math.inf, False

    def warn(self, text: str) -> None:
        """Logs a warning, unless the last was less than a period ago."""
        now = time.monotonic()
        if now - self._warned >= self._period:
            self._warned, self._stands = now, True
            rospy.logwarn("%s", text)

    def end(self) -> None:
        """Logs that the condition has ended, once after a warning."""
        if self._stands:
            self._stands = False
            rospy.loginfo("%s", self._ended)
