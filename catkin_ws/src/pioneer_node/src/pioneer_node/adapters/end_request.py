"""The wish that a process ends, as a signal brings it."""

import os
import select


class EndRequest:
    """Like ``threading.Event``, but to be set by a signal handler.

    A handler runs in the main thread, between any two instructions of it. Where the main thread waits for an Event it
    may hold that Event's lock just then, and ``set`` would wait for it for ever. Here is no lock.
    """

    def __init__(self) -> None:
        self._is_set = False
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def is_set(self) -> bool:
        """Returns whether the end was asked for."""
        return self._is_set

    def set(self) -> None:
        """Asks for the end."""
        self._is_set = True
        os.eventfd_write(self._wake, 1)

    def wait(self, timeout: float) -> bool:
        """Waits until the end is asked for, ``timeout`` seconds at most, and returns whether it was."""
        if not self._is_set:
            select.select([self._wake], [], [], timeout)
        return self._is_set
