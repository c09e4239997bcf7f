"""A shutdown flag that is safe to set from a signal handler."""

import contextlib
import math
import os
import select
import signal
from collections.abc import Iterable


class EndRequest:
    """Like ``threading.Event``, but safe to set from a signal handler: it takes no lock.

    A handler runs in the main thread, between any two of its instructions. If the main thread is waiting for an Event
    at that moment it may hold the Event's lock, and ``set`` would deadlock.
    """

    def __init__(self) -> None:
        self.number = 0  #: the signal that made the request, of those given to `take_signals`; 0 for none
        self._is_set = False
        self._signals: int | None = None
        self._numbers: tuple[int, ...] = ()
        # Debian 12's mypy does not know eventfd, which Python has had since 3.10.
        self._wake: int = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)  # type: ignore[attr-defined]

    def is_set(self) -> bool:
        """Returns whether shutdown was requested."""
        return self._is_set

    def take_signals(self, *numbers: int) -> None:
        """Has each of these signals request shutdown; for the main thread, and one request of a process.

        Python runs a handler in the main thread only, once that runs: if it goes to sleep on a lock just then, or if
        the kernel gives the signal to another thread, that may be never. So we have Python write the number of each
        signal into a pipe too, at once and in whichever thread, and who waits for the request reads it there.
        """
        self._numbers = numbers
        if self._signals is None:
            self._signals, writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
            signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
        for number in numbers:
            signal.signal(number, lambda taken, _: self._take(taken))

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
            for descriptor in (self._wake, *beside, *(() if self._signals is None else (self._signals,))):
                poll.register(descriptor, select.POLLIN)
            poll.poll(None if timeout is None else math.ceil(timeout * 1000))
            self._read_signals()
            self._forget_wakes()
        return self._is_set

    def _take(self, number: int) -> None:
        self.number = self.number or number
        self.set()

    def _read_signals(self) -> None:
        if self._signals is not None:
            with contextlib.suppress(BlockingIOError):
                for number in os.read(self._signals, 4096):
                    if number in self._numbers:
                        self._take(number)

    def _forget_wakes(self) -> None:
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._wake)  # type: ignore[attr-defined]
        if self._is_set:  # its own wake was among them, and others may wait for that
            os.eventfd_write(self._wake, 1)  # type: ignore[attr-defined]
