"""Warnings that repeat while their cause lasts, with a final line when it has ended."""

import logging
import math
import time

_PERIOD = 5.0
"""Minimum time between two lines of one warning [s of wall time]."""

Logger = logging.Logger | logging.LoggerAdapter[logging.Logger]


class StandingWarning:
    """A fault condition of a node that should not last.

    Threads: use it from one thread only.

    Args:
        ended: text to log once when the condition has ended, if a warning was logged.
        period: minimum time between two warnings [s].
        logger: the node's logger; None for rospy's.
    """

    def __init__(self, ended: str, period: float = _PERIOD, logger: Logger | None = None) -> None:
        self._ended, self._period = ended, period
        self._logger = logger or logging.getLogger("rosout")
        self._warned, self._stands = -math.inf, False

    def warn(self, text: str) -> None:
        """Logs a warning, unless the last was less than a period ago."""
        now = time.monotonic()
        if now - self._warned >= self._period:
            self._warned, self._stands = now, True
            self._logger.warning("%s", text)

    def end(self) -> None:
        """Logs that the condition has ended, if a warning was logged; only once."""
        if self._stands:
            self._stands = False
            self._logger.info("%s", self._ended)
