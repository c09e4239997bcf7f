"""Waits for a condition instead of a fixed time."""

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from pioneer_harness.error import WaitError

Value = TypeVar("Value")

START = 60.0
"""Generous time-out for a process to start [s]: startup depends on the machine and is not what is tested."""

_POLL_INTERVAL = 0.02


def wait_until(
    condition: Callable[[], Value], what: str, timeout: float, notified: threading.Condition | None = None
) -> Value:
    """Returns the first true value of ``condition()``.

    Args:
        condition: called repeatedly in the caller's thread.
        what: description for the error: "the map on /map".
        timeout: [s] of monotonic wall time.
        notified: if given, ``condition`` is called with it held, after each notification instead of by polling.

    Raises:
        WaitError: the condition was still false at the time-out. Exceptions from ``condition`` pass through.
    """
    deadline = time.monotonic() + timeout
    if notified is None:
        return _first_true(condition, what, timeout, deadline, lambda: time.sleep(_POLL_INTERVAL))
    lock = notified
    with lock:
        return _first_true(condition, what, timeout, deadline, lambda: lock.wait(deadline - time.monotonic()))


def _first_true(
    condition: Callable[[], Value], what: str, timeout: float, deadline: float, pause: Callable[[], object]
) -> Value:
    while not (value := condition()):
        if time.monotonic() >= deadline:
            raise WaitError(f"{what}: not within {timeout:g} s; the last value was {value!r}")
        pause()
    return value
