"""Termination signals, polled between two steps instead of raised in the middle of one."""

import contextlib
import os
import select
import signal
import threading
import time

from pioneer_demo.error import DemoError
from pioneer_node.adapters.end_request import EndRequest

_FINAL = 2
"""Number of signals that ends the process in any case."""
_GRACE = 10.0
"""Time to end everything after the second signal, if the process has reacted to the first one [s]."""
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


class Interrupted(DemoError):  # noqa: N818 - no error: a request
    """The user or the system requested that the command end."""

    def __init__(self, number: int) -> None:
        super().__init__("Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name)
        self.status = 128 + number  #: exit status: 128 + signal number


class Interrupt(EndRequest):
    """Records SIGINT, SIGTERM, SIGHUP and SIGQUIT, even if the shell has set them to ignored.

    ``./pioneer`` starts Python with these signals blocked, so that a signal that arrives during interpreter startup
    stays pending until they are unblocked here.
    """

    def __init__(self) -> None:
        super().__init__()
        self.take_signals(*_SIGNALS)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)

        self._is_noticed = False
        self._count = 0
        threading.Thread(target=self._watch, name="signals", daemon=True).start()

    def _watch(self) -> None:
        """Ends the process after the second signal, however its other threads are blocked.

        At once if the main thread has not reacted to the first one, or else once it had time to end everything. The
        processes that it started get SIGTERM from the kernel then.
        """
        while self._count < _FINAL:
            select.select([self._signals], [], [])
            self._count_signals()
        if self._is_noticed:
            time.sleep(_GRACE)
        with contextlib.suppress(OSError):
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

    def check(self) -> None:
        """Raises ``Interrupted`` once one of the signals has arrived."""
        self._is_noticed = self._is_noticed or bool(self.number)
        if self.number == signal.SIGHUP:
            mute()  # the terminal is gone: every write to it would fail
        if self.number:
            raise Interrupted(self.number)


def mute() -> None:
    """Redirects the process's further output to /dev/null, because its receiver no longer exists."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for output in (1, 2):
        os.dup2(nowhere, output)
    os.close(nowhere)
