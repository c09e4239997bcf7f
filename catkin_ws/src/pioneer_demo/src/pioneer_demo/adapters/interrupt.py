"""Termination signals, polled between two steps instead of raised in the middle of one."""

import os
import signal
import types

from pioneer_demo.core.error import DemoError

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


class Interrupted(DemoError):  # noqa: N818 - no error: a request
    """The user or the system requested that the command end."""

    def __init__(self, number: int) -> None:
        super().__init__("Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name)
        self.status = 128 + number  #: exit status: 128 + signal number


class Interrupt:
    """Records SIGINT, SIGTERM, SIGHUP and SIGQUIT, even if the shell has set them to ignored.

    ``./pioneer`` starts Python with these signals blocked, so that a signal that arrives during interpreter startup
    stays pending until they are unblocked here.
    """

    def __init__(self) -> None:
        self._number = 0
        for number in _SIGNALS:
            signal.signal(number, self._note)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)

    def has_come(self) -> bool:
        """Returns whether one of the signals has arrived."""
        return bool(self._number)

    def check(self) -> None:
        """Raises ``Interrupted`` once one of the signals has arrived."""
        if self._number == signal.SIGHUP:
            mute()  # the terminal is gone: every write to it would fail
        if self._number:
            raise Interrupted(self._number)

    def _note(self, number: int, frame: types.FrameType | None) -> None:
        self._number = self._number or number


def mute() -> None:
    """Redirects the process's further output to /dev/null, because its receiver no longer exists."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for output in (1, 2):
        os.dup2(nowhere, output)
    os.close(nowhere)
