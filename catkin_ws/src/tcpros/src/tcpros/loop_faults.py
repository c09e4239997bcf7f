"""The handler of outermost loops: an unexpected exception costs one step of a loop, never the loop."""

import contextlib
import errno
import logging
from types import TracebackType

MAX_REMEMBERED = 16
"""Number of different faults of a loop that are logged."""


EXHAUSTED = (
    errno.EMFILE,
    errno.ENFILE,
    errno.ENOMEM,
    errno.ENOBUFS,
    errno.ENOSPC,
    errno.EDQUOT,
)
"""Errors of a process or machine that has run out of something; no traceback explains them better.

Not EAGAIN: beside a refused fork, it is what a socket or pipe raises that was read or written too early, a bug.
"""


class LoopFaults:
    """Takes the exceptions of a loop's steps; logs each fault once.

    A bug is logged with its traceback, an error of `EXHAUSTED` in one line.

        with faults:
            step()
        if faults.has_failed:
            pause()

    Only for the outermost loop of a thread or process: an exception that gets there is a bug, or a fault of the machine
    that nobody thought of.

    Args:
        logger: receives the lines.
        what: names the loop in them.
    """

    def __init__(self, logger: logging.Logger, what: str) -> None:
        self.has_failed = False  #: whether the last step has failed
        self._logger = logger
        self._what = what
        self._logged: set[str] = set()

    def __enter__(self) -> None:
        self.has_failed = False

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        error: BaseException | None,
        _trace: TracebackType | None,
    ) -> bool:
        if not isinstance(error, Exception):
            return False
        self.has_failed = True
        self.take(error)
        return True

    def take(self, error: Exception) -> None:
        """Logs an exception that a loop has caught itself."""
        fault = f"{type(error).__name__}: {error}"
        if fault in self._logged or len(self._logged) >= MAX_REMEMBERED:
            return
        self._logged.add(fault)
        # A line that cannot be written, as on a full disk, must not end the loop either.
        with contextlib.suppress(Exception):
            if isinstance(error, OSError) and error.errno in EXHAUSTED:
                self._logger.error("%s lacks something and continues: %s", self._what, error)
                return
            self._logger.critical(
                "internal error in %s, which continues; it is logged once",
                self._what,
                exc_info=error,
            )
