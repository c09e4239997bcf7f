"""roslaunch learns of the end of a process as it happens, in place of looking ten times a second in two threads."""

import contextlib
import os
import select
import threading
import time
from collections.abc import Callable, Iterable
from types import SimpleNamespace
from typing import Any

LONGEST = 2.0
"""How long roslaunch waits where nothing happens [s]."""

_REPORTED = 0.01
"""Pause where a process has ended and its end has not been reported yet [s]."""


class ProcessWatch:
    """Stands in the place of ``time.sleep`` in roslaunch's process monitor: it waits for what the monitor looks for.

    That is the end of one of its processes, its own end, and a process that is new.
    """

    def __init__(self) -> None:
        self._bells: dict[int, int] = {}

    def sleep(self, seconds: float) -> None:
        """Waits until something has happened to the monitor that runs in this thread, or to any; `LONGEST` at most.

        So long as a process is not started or waits for its respawn, ``seconds`` at most.
        """
        monitored: Iterable[Any] = getattr(threading.current_thread(), "procs", ())
        with contextlib.ExitStack() as opened:
            poll = select.poll()
            try:
                for process in tuple(monitored):
                    handle = os.pidfd_open(process.popen.pid)
                    opened.callback(os.close, handle)
                    poll.register(handle, select.POLLIN)
            except (OSError, AttributeError):
                time.sleep(seconds)
                return
            if poll.poll(0):
                time.sleep(_REPORTED)
                return
            bell = self._bell()
            poll.register(bell, select.POLLIN)
            poll.poll(LONGEST * 1000)
            with contextlib.suppress(BlockingIOError):
                os.eventfd_read(bell)  # type: ignore[attr-defined]

    def then_ring(self, method: Callable[..., Any]) -> Callable[..., Any]:
        """Returns the method, which ends every wait when it returns."""

        def ringing(*arguments: Any, **named: Any) -> Any:
            try:
                return method(*arguments, **named)
            finally:
                for bell in tuple(self._bells.values()):
                    os.eventfd_write(bell, 1)  # type: ignore[attr-defined]

        return ringing

    def _bell(self) -> int:
        thread = threading.get_ident()
        if thread not in self._bells:
            self._bells[thread] = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)  # type: ignore[attr-defined]
        return self._bells[thread]


def watch_processes() -> None:
    """Has roslaunch in this process wait for its processes."""
    import roslaunch.pmon

    watch, monitor = ProcessWatch(), roslaunch.pmon.ProcessMonitor
    roslaunch.pmon.time = SimpleNamespace(sleep=watch.sleep, time=time.time)
    for name in ("shutdown", "register", "register_core_proc", "run"):
        setattr(monitor, name, watch.then_ring(getattr(monitor, name)))
