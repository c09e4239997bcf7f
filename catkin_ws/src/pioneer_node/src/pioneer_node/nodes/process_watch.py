"""roslaunch learns of the end of a process as it happens, in place of looking ten times a second in two threads."""

import threading
import time
from collections.abc import Callable, Iterable
from types import SimpleNamespace
from typing import Any

from pioneer_node.adapters.end_request import EndRequest
from pioneer_node.adapters.process_end import await_end

LONGEST = 2.0
"""How long roslaunch waits where nothing happens [s]."""

_REPORTED = 0.01
"""Pause where a process has ended and its end has not been reported yet [s]."""


class ProcessWatch:
    """Stands in the place of ``time.sleep`` in roslaunch's process monitor: it waits for what the monitor looks for.

    That is the end of one of its processes, its own end, and a process that is new.
    """

    def __init__(self) -> None:
        self._bells: dict[int, EndRequest] = {}

    def sleep(self, seconds: float) -> None:
        """Waits until something has happened to the monitor that runs in this thread, or to any; `LONGEST` at most.

        So long as a process is not started or waits for its respawn, ``seconds`` at most.
        """
        monitored: Iterable[Any] = getattr(threading.current_thread(), "procs", ())
        running: list[Any] = [getattr(process, "popen", None) for process in tuple(monitored)]
        if any(one is None or one.poll() is not None for one in running):
            time.sleep(seconds)
        else:
            await_end([one.pid for one in running], self._bell(), _REPORTED, LONGEST)

    def then_ring(self, method: Callable[..., Any]) -> Callable[..., Any]:
        """Returns the method, which ends every wait when it returns."""

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
    """Has roslaunch in this process wait for its processes."""
    import roslaunch.pmon

    watch, monitor = ProcessWatch(), roslaunch.pmon.ProcessMonitor
    roslaunch.pmon.time = SimpleNamespace(sleep=watch.sleep, time=time.time)
    for name in ("shutdown", "register", "register_core_proc", "run"):
        setattr(monitor, name, watch.then_ring(getattr(monitor, name)))
