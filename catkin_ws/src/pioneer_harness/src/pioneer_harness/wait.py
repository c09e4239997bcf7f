"""Waits for a condition instead of a fixed time."""

import contextlib
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
    condition: Callable[[], Value],
    what: str,
    timeout: float,
    notified: threading.Condition | None = None,
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
    with notified or contextlib.nullcontext():
        while not (value := condition()):
            left = deadline - time.monotonic()
            if left <= 0.0:
                raise WaitError(f"{what}: not within {timeout:g} s; the last value was {value!r}")
            if notified is None:
                time.sleep(_POLL_INTERVAL)
            else:
                notified.wait(left)
    return value
