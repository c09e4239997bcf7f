"""Ctrl-C as something to look at between two steps, not as an exception in the middle of one."""

import signal
import types

from pioneer_demo.core.error import DemoError


class Interrupted(DemoError):  # noqa: N818 - no error, a wish
    """The person at the keyboard, or the system, wants this to end.

    Attributes:
        status: the exit status that says so: 128 and the signal's number.
    """

    def __init__(self, number: int) -> None:
        super().__init__("Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name)
        self.status = 128 + number


class Interrupt:
    """Notes SIGINT, SIGTERM and SIGHUP from its creation on, even where the shell had them ignored."""

    def __init__(self) -> None:
        self._number = 0
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._note)

    def has_come(self) -> bool:
        """Returns whether one of the signals has come."""
        return bool(self._number)

    def check(self) -> None:
        """Raises ``Interrupted`` once one of the signals has come."""
        if self._number:
            raise Interrupted(self._number)

    def _note(self, number: int, frame: types.FrameType | None) -> None:
        self._number = self._number or number
