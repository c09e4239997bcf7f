"""Work queue of the thread that owns the simulation, filled by the threads of services and subscribers."""

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

Result = TypeVar("Result")


class ClosedError(Exception):
    """The simulator has shut down and accepts no more work."""


class Mailbox:
    """A work queue with a bell on which the owner sleeps.

    The bell is a lock that is released to ring it. Waiting for a lock costs a tenth of waiting for a condition, and the
    owner waits at every tick.
    """

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._bell = threading.Lock()
        self._bell.acquire()
        self._waiting: deque[tuple[Future[Any], Callable[[], Any]]] = deque()
        self._closed = False

    def call(self, work: Callable[[], Result]) -> Result:
        """Runs ``work`` in the owner's thread; waits for it, and returns its result or raises its exception.

        Raises:
            ClosedError: the owner has shut down.
        """
        return self._put(work).result()

    def post(self, work: Callable[[], Any]) -> None:
        """Queues ``work`` for the owner without waiting; its exceptions are discarded, as is work after `close`."""
        with contextlib.suppress(ClosedError):
            self._put(work)

    def _put(self, work: Callable[[], Result]) -> Future[Result]:
        future = Future[Result]()
        with self._guard:
            if self._closed:
                raise ClosedError("the simulator has ended")
            self._waiting.append((future, work))
            self._ring()
        return future

    def _ring(self) -> None:
        """Rings the bell; the caller must hold the guard."""
        if self._bell.locked():
            self._bell.release()

    def wait(self, timeout: float) -> bool:
        """Sleeps until new work, `close`, or ``timeout`` [s]; returns False after a timeout.

        May return True once for work that has already been done.
        """
        return self._bell.acquire(timeout=timeout)

    @property
    def pending(self) -> bool:
        """Whether work is queued."""
        return bool(self._waiting)

    def serve(self) -> None:
        """Does all queued work; called by the owner."""
        while self._waiting:
            future, work = self._waiting.popleft()
            try:
                future.set_result(work())
            except Exception as error:  # noqa: BLE001 - handed to the caller that waits for the result
                future.set_exception(error)

    def close(self) -> None:
        """Rejects further work and cancels queued work."""
        with self._guard:
            self._closed = True
            while self._waiting:
                self._waiting.popleft()[0].set_exception(ClosedError("the simulator has ended"))
            self._ring()
