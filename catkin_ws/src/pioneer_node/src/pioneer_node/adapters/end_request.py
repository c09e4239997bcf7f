"""A shutdown flag that is safe to set from a signal handler."""

import contextlib
import math
import os
import select
import signal
from collections.abc import Iterable


class EndRequest:
    """Like ``threading.Event``, but safe to set from a signal handler: it takes no lock.

    A handler interrupts the main thread between any two instructions. If the main thread is waiting for an Event at
    that moment, it may hold the Event's lock, and ``set`` would deadlock.
    """

    def __init__(self) -> None:
        self.number = (
            0  #: the signal that requested shutdown, of those given to `take_signals`; 0 for none
        )
        self._is_set = False
        self._signals: int | None = None
        self._numbers: tuple[int, ...] = ()
        # Debian 12's mypy does not know eventfd, which Python has had since 3.10.
        self._wake: int = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)  # type: ignore[attr-defined]

    def is_set(self) -> bool:
        """Returns whether shutdown was requested."""
        return self._is_set

    def take_signals(self, *numbers: int) -> None:
        """Makes each of these signals request shutdown. Call from the main thread, for one `EndRequest` per process.

        Python runs handlers only in the main thread, and only once that runs again: never, if it blocks on a lock just
        then or if the kernel delivers the signal to another thread. So Python also writes each signal number into a
        pipe (wake-up fd), at once and from any thread; the thread that waits for the request reads the pipe.
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
        """Wakes up the waiting thread without requesting shutdown, because of some other event."""
        os.eventfd_write(self._wake, 1)  # type: ignore[attr-defined]

    def wait(self, timeout: float | None = None, beside: Iterable[int] = ()) -> bool:
        """Waits for a shutdown request; returns whether one was made.

        Args:
            timeout: maximum time [s]; None for no limit.
            beside: file descriptors that also end the wait once they are readable.
        """
        if not self._is_set:
            poll = select.poll()
            for descriptor in (
                self._wake,
                *beside,
                *(() if self._signals is None else (self._signals,)),
            ):
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
        if self._is_set:  # keep the fd readable, because other threads may wait for the request
            os.eventfd_write(self._wake, 1)  # type: ignore[attr-defined]
