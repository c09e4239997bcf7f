"""Termination signals, polled between two steps instead of raised in the middle of one."""

import os
import signal

from pioneer_demo.core.error import DemoError
from pioneer_node.adapters.end_request import EndRequest

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

    def check(self) -> None:
        """Raises ``Interrupted`` once one of the signals has arrived."""
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
