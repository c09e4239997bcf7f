"""Termination signals, polled between two steps instead of raised in the middle of one."""

import os
import signal

from pioneer_demo.error import DemoError
from pioneer_node.adapters.forced_end import ForcedEnd

_GRACE = 10.0
"""Time to end everything after the second signal, if the process has reacted to the first one [s]."""
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


class Interrupted(DemoError):  # noqa: N818 - no error: a request
    """The user or the system requested that the command end."""

    def __init__(self, number: int) -> None:
        super().__init__("Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name)
        self.status = 128 + number  #: exit status: 128 + signal number


class Interrupt(ForcedEnd):
    """Records SIGINT, SIGTERM, SIGHUP and SIGQUIT, even if the shell has set them to ignored.

    ``./pioneer`` starts Python with these signals blocked, so that a signal that arrives during interpreter startup
    stays pending until they are unblocked here. The second signal ends the process: at once if the main thread has not
    reacted to the first one, or else once it had time to end everything. The processes that it started get SIGTERM
    from the kernel then.
    """

    def __init__(self) -> None:
        self._is_noticed = False
        super().__init__(*_SIGNALS)

    def grace(self) -> float:
        """Returns the time to end everything, if the main thread is doing that [s]."""
        return _GRACE if self._is_noticed else 0.0

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
