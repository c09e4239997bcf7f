"""A shutdown flag whose second signal ends the process, however its threads are blocked."""

import contextlib
import os
import select
import signal
import threading
import time
from collections.abc import Callable

from pioneer_node.adapters.end_request import EndRequest

_FINAL = 2
"""Number of signals that ends the process in any case."""


class ForcedEnd(EndRequest):
    """Sets the flag at the first of these signals and ends the process at the second, with status 128 + its number.

    Args:
        numbers: the signals.
        before: called before the process is ended, to leave the terminal as it was.

    Threads: one, which waits for signals.
    """

    def __init__(self, *numbers: int, before: Callable[[], object] = lambda: None) -> None:
        super().__init__()
        self._before = before
        self._count = 0
        self.take_signals(*numbers)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)
        threading.Thread(target=self._watch, name="signals", daemon=True).start()

    def grace(self) -> float:
        """Returns the time that the process gets after the second signal [s]."""
        return 0.0

    def _watch(self) -> None:
        while self._count < _FINAL:
            select.select([self._signals], [], [])
            self._count_signals()
        time.sleep(self.grace())
        with contextlib.suppress(OSError):
            self._before()
            os.write(2, b"ended by the second signal; what was under way is incomplete\n")
        os._exit(128 + self.number)

    def _read_signals(self) -> None:
        """Leaves the signals to the thread that counts them."""

    def _count_signals(self) -> None:
        if self._signals is not None:
            with contextlib.suppress(BlockingIOError):
                for number in os.read(self._signals, 4096):
                    if number in self._numbers:
                        self._count += 1
                        self._take(number)
