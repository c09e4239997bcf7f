"""Waiting for a condition instead of for an amount of time."""

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from pioneer_harness.error import WaitError

Value = TypeVar("Value")

START = 60.0
"""So long a process may take to start [s]: that is the machine's business, and not what is tested."""

_POLL_INTERVAL = 0.02


def wait_until(
    condition: Callable[[], Value], what: str, timeout: float, notified: threading.Condition | None = None
) -> Value:
    """Returns the first true value of ``condition()``.

    Args:
        condition: called again and again, in the caller's thread.
        what: what is awaited, for the error: "the map on /map".
        timeout: [s] of monotonic wall time.
        notified: where given, ``condition`` is called holding it, and again after each notification, not by polling.

    Raises:
        WaitError: the condition was still false at the end; whatever ``condition`` raises passes through.
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
