"""Work queue of the thread that owns the simulation, and the services of ``/gazebo``, which fill it."""

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

import rospy

from pioneer_gazebo.error import SimulatorError

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


LONGEST = 400
"""Maximum length of an error text [characters]; names sent by clients may have millions."""


def serve(
    name: str, kind: Any, handler: Callable[[Any], Any], mailbox: Mailbox | None = None
) -> None:
    """Serves ``/gazebo/NAME`` with ``handler``, in the thread of ``mailbox`` or, without one, in the service's own.

    The handler returns a response, the text of an otherwise default response, or None; ``success`` and "ok" are filled
    in. For an invalid request, ``success`` is false and ``status_message`` has one line, which is also logged; if the
    response type has no such field, the call fails with that line.
    """

    def answer(request: Any) -> Any:
        try:
            found = handler(request) if mailbox is None else mailbox.call(lambda: handler(request))
        except (SimulatorError, ValueError, ClosedError) as error:
            text = str(error)
            text = (
                text
                if len(text) <= LONGEST
                else f"{text[: LONGEST // 2]} … {text[-LONGEST // 2 :]}"
            )
            rospy.logerr("%s: %s", name, text)
            return _stated(kind._response_class(), False, text)
        response = kind._response_class() if found is None or isinstance(found, str) else found
        return _stated(response, True, found if isinstance(found, str) else "ok")

    rospy.Service(f"/gazebo/{name}", kind, answer)


def _stated(response: Any, success: bool, text: str) -> Any:
    """Returns the response with its success and text fields set, if it has them; keeps an existing text.

    Raises:
        rospy.ServiceException: the request failed and the response has no such fields.
    """
    for field in ("status_message", "message"):
        if hasattr(response, field):
            response.success = success
            setattr(response, field, getattr(response, field) or text)
            return response
    if not success:
        raise rospy.ServiceException(text)
    return response
