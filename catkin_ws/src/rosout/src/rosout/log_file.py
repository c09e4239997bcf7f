"""The file ``rosout.log``."""

import logging
import logging.handlers
import sys
from collections.abc import Callable
from pathlib import Path

FILE_SIZE, FILES = 100_000_000, 10
"""Size at which the file is replaced, and number of former ones that stay."""


class LogFile(logging.handlers.RotatingFileHandler):
    """Appends lines.

    Args:
        path: the file.
        complain: called once with the reason when it cannot be written, and again after it could be.
    """

    def __init__(self, path: Path, complain: Callable[[str], object]) -> None:
        super().__init__(
            path, maxBytes=FILE_SIZE, backupCount=FILES, delay=True, errors="backslashreplace"
        )
        self._complain = complain
        self._is_faulty = self._has_failed = False

    def write(self, line: str) -> None:
        """Appends a line."""
        self._has_failed = False
        self.handle(logging.makeLogRecord({"msg": line}))
        self._is_faulty = self._has_failed

    def handleError(self, record: logging.LogRecord) -> None:
        """Reports the exception being handled, once."""
        self._has_failed = True
        if not self._is_faulty:
            self._complain(f"{self.baseFilename} cannot be written: {sys.exc_info()[1]}")
