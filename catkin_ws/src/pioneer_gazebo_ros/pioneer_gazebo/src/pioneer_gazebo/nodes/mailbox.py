"""Work for the one thread that owns the simulation, handed over by the threads of services and subscribers."""

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

Result = TypeVar("Result")


class ClosedError(Exception):
    """The simulator has ended and does no more work."""


class Mailbox:
    """A queue of work with a bell that the owner sleeps on.

    The bell is a lock that is released to ring: waiting for it costs a tenth of what waiting for a condition does, and
    the owner waits at every tick.
    """

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._bell = threading.Lock()
        self._bell.acquire()
        self._waiting: deque[tuple[Future[Any], Callable[[], Any]]] = deque()
        self._closed = False

    def call(self, work: Callable[[], Result]) -> Result:
        """Has the owner do ``work``, waits for it, and returns its result or raises what it raised.

        Raises:
            ClosedError: the owner has ended.
        """
        return self._put(work).result()

    def post(self, work: Callable[[], Any]) -> None:
        """Has the owner do ``work`` and does not wait; what it raises is lost, and so is work after the end."""
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
        """Rings the bell; called with the guard held."""
        if self._bell.locked():
            self._bell.release()

    def wait(self, timeout: float) -> bool:
        """Sleeps until there is new work, until `close`, or until ``timeout`` [s] has passed: returns False then.

        May return True once for work that has been done already.
        """
        return self._bell.acquire(timeout=timeout)

    @property
    def pending(self) -> bool:
        """Whether work waits."""
        return bool(self._waiting)

    def serve(self) -> None:
        """Does all work that has come in; called by the owner."""
        while self._waiting:
            future, work = self._waiting.popleft()
            try:
                future.set_result(work())
            except Exception as error:  # noqa: BLE001 - handed to the caller that waits for the result
                future.set_exception(error)

    def close(self) -> None:
        """Refuses further work and gives up what is waiting."""
        with self._guard:
            self._closed = True
            while self._waiting:
                self._waiting.popleft()[0].set_exception(ClosedError("the simulator has ended"))
            self._ring()
