"""Notifies roslaunch when a process ends, instead of two threads polling ten times a second."""

import logging
import threading
import time
from collections.abc import Callable, Iterable
from types import SimpleNamespace
from typing import Any

from pioneer_launch.process_end import await_end
from pioneer_node.adapters.end_request import EndRequest
from tcpros.loop_faults import LoopFaults

LONGEST = 2.0
"""Maximum time roslaunch waits without an event [s]."""

_REPORTED = 0.01
"""Pause while the end of a process is not yet reported [s]."""


class ProcessWatch:
    """Replaces ``time.sleep`` in roslaunch's process monitor by a wait for the events that the monitor polls for.

    These are: one of its processes ends, the monitor itself ends, a process is added.
    """

    def __init__(self) -> None:
        self._bells: dict[int, EndRequest] = {}
        self._faults = LoopFaults(logging.getLogger("roslaunch"), "roslaunch's process monitor")

    def sleep(self, seconds: float) -> None:
        """Waits for an event of this thread's monitor, or for any wake-up; at most `LONGEST`.

        While a process is not started or waits for its respawn, sleeps for ``seconds``.
        """
        # roslaunch has no handler here: an exception would end its monitor, and no node would be started again.
        with self._faults:
            self._await_event(seconds)
        if self._faults.has_failed:
            time.sleep(seconds)  # poll, as roslaunch does

    def _await_event(self, seconds: float) -> None:
        monitored: Iterable[Any] = getattr(threading.current_thread(), "procs", ())
        running: list[Any] = [getattr(process, "popen", None) for process in tuple(monitored)]
        if any(one is None or one.poll() is not None for one in running):
            time.sleep(seconds)
        else:
            await_end([one.pid for one in running], self._bell(), _REPORTED, LONGEST)

    def then_ring(self, method: Callable[..., Any]) -> Callable[..., Any]:
        """Wraps a method so that it wakes up all waiting threads when it returns."""

        def ringing(*arguments: Any, **named: Any) -> Any:
            try:
                return method(*arguments, **named)
            finally:
                for bell in tuple(self._bells.values()):
                    bell.wake()

        return ringing

    def _bell(self) -> EndRequest:
        thread = threading.get_ident()
        if thread not in self._bells:
            self._bells[thread] = EndRequest()
        return self._bells[thread]


def watch_processes() -> None:
    """Makes roslaunch in this process wait for its processes instead of polling."""
    import roslaunch.pmon

    watch, monitor = ProcessWatch(), roslaunch.pmon.ProcessMonitor
    roslaunch.pmon.time = SimpleNamespace(sleep=watch.sleep, time=time.time)
    for name in ("shutdown", "register", "register_core_proc", "run"):
        setattr(monitor, name, watch.then_ring(getattr(monitor, name)))
