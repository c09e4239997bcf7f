"""A shutdown flag that is safe to set from a signal handler."""

import contextlib
import math
import os
import select
from collections.abc import Iterable


class EndRequest:
    """Like ``threading.Event``, but safe to set from a signal handler: it takes no lock.

    A handler runs in the main thread, between any two of its instructions. If the main thread is waiting for an Event
    at that moment it may hold the Event's lock, and ``set`` would deadlock.
    """

    def __init__(self) -> None:
        self._is_set = False
        # Debian 12's mypy does not know eventfd, which Python has had since 3.10.
        self._wake: int = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)  # type: ignore[attr-defined]

    def is_set(self) -> bool:
        """Returns whether shutdown was requested."""
        return self._is_set

    def set(self) -> None:
        """Requests shutdown."""
        self._is_set = True
        os.eventfd_write(self._wake, 1)  # type: ignore[attr-defined]

    def wake(self) -> None:
        """Ends a wait without a request: something else has happened that the waiting thread wants to know."""
        os.eventfd_write(self._wake, 1)  # type: ignore[attr-defined]

    def wait(self, timeout: float | None = None, beside: Iterable[int] = ()) -> bool:
        """Waits for the request; returns whether it was made.

        Args:
            timeout: at most so long [s]; None for any time.
            beside: file descriptors that end the wait, too, once they can be read.
        """
        if not self._is_set:
            poll = select.poll()
            for descriptor in (self._wake, *beside):
                poll.register(descriptor, select.POLLIN)
            poll.poll(None if timeout is None else math.ceil(timeout * 1000))
            self._forget_wakes()
        return self._is_set

    def _forget_wakes(self) -> None:
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._wake)  # type: ignore[attr-defined]
        if self._is_set:  # its own wake was among them, and others may wait for that
            os.eventfd_write(self._wake, 1)  # type: ignore[attr-defined]
