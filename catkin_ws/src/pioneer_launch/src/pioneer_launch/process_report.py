"""Deaths of nodes, as roslaunch's process monitor reports them, in a file of JSON lines for another process.

It works with the switch off, too: those who started a fleet must know which node has died.
"""

import contextlib
import ctypes
import dataclasses
import json
import os
import re
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

REPORT = "PIONEER_PROCESS_REPORT"
"""Variable: the file to which a launcher appends the deaths of its nodes; none if it is not set."""
RESERVED = 64 * 1024
"""Room that a report has on the disk from the start [bytes]: lines of some hundred deaths."""
RETRY = 1.0
"""Pause before a line that could not be written is tried again [s]."""
_KEEP_SIZE = 1
"""FALLOC_FL_KEEP_SIZE of Linux: space is allocated behind the end of the file."""
_COUNT = re.compile(r"-\d+$")
"""What roslaunch appends to the name of a node to name its process."""


@dataclasses.dataclass(frozen=True)
class NodeDeath:
    """A node that has ended without being asked to."""

    name: str  #: its full name without the leading slash
    pid: int  #: its process id
    #: exit status, negative signal number if a signal ended it; None if roslaunch does not know it
    status: int | None
    log: str  #: glob pattern of its log files; empty if it has none
    respawns: bool  #: whether roslaunch starts it again
    time: float = 0.0  #: when the death was noticed [s of wall time since the epoch]


def begin_report(path: Path) -> None:
    """Makes an empty report with room on the disk, so that deaths on a full disk get into it, too.

    Some file systems cannot reserve room; then those deaths are reported once there is space again.
    """
    with path.open("wb") as report:
        size = ctypes.c_int64(RESERVED)
        ctypes.CDLL(None).fallocate(report.fileno(), _KEEP_SIZE, ctypes.c_int64(0), size)


def written(death: NodeDeath) -> str:
    """Returns a death as one line of JSON."""
    return json.dumps(dataclasses.asdict(death)) + "\n"


def deaths_in(text: str) -> Iterator[NodeDeath]:
    """Yields the deaths in complete lines of a report; a line that was cut, by a full disk and a kill, is left out."""
    for line in text.splitlines():
        try:
            fields = json.loads(line)
        except ValueError:
            continue
        yield NodeDeath(**fields)


def report_deaths() -> None:
    """Makes the process monitors of this process append to the report, if the environment names one."""
    name = os.environ.get(REPORT)
    if not name:
        return
    path = Path(name)
    from roslaunch import pmon

    start = pmon.start_process_monitor

    def start_process_monitor() -> Any:
        # Before any process is registered: ROSLaunchParent adds its listeners after it has started the nodes.
        monitor = start()
        if monitor is not None:
            monitor.add_process_listener(Listener(monitor, path))
        return monitor

    pmon.start_process_monitor = start_process_monitor


class Listener:
    """Has the methods of ``roslaunch.pmon.ProcessListener``: appends the deaths that a monitor reports.

    What cannot be written, as on a full disk, is tried again each `RETRY`. An exception would make roslaunch's monitor
    forget the node instead of starting it again.

    Args:
        monitor: roslaunch's process monitor.
        path: the report.
    """

    def __init__(self, monitor: Any, path: Path) -> None:
        self._monitor, self._path = monitor, path
        self._reported: dict[str, int] = {}
        self._lock = threading.Lock()
        self._unwritten = b""
        self._is_retrying = False

    def process_died(self, process_name: str, exit_code: int | None) -> None:
        """Appends the death, once: roslaunch calls this again and again until it starts the node again."""
        line = self._line(process_name, exit_code)
        with self._lock:
            self._unwritten += line.encode()
            if not self._is_retrying:
                self._write()

    def _retry(self) -> None:
        with self._lock:
            self._write()

    def _write(self) -> None:
        """Appends what is not written yet."""
        self._is_retrying = False
        if not self._unwritten:
            return
        with contextlib.suppress(OSError), self._path.open("ab", buffering=0) as report:
            self._unwritten = self._unwritten[report.write(self._unwritten) :]
        if self._unwritten:
            timer = threading.Timer(RETRY, self._retry)
            timer.daemon = True
            with contextlib.suppress(
                RuntimeError
            ):  # no more threads: tried again at the next death
                timer.start()
                self._is_retrying = True

    def _line(self, process_name: str, exit_code: int | None) -> str:
        """Returns the line about a death; empty if it is reported already, or no failure."""
        process = self._monitor.get_process(process_name)
        if process is None or exit_code == 0:
            return ""
        if self._reported.get(process_name) == process.spawn_count:
            return ""
        self._reported[process_name] = process.spawn_count
        folder = getattr(process, "log_dir", None)
        log = os.path.join(folder, f"{process_name.replace('/', '-')}*.log") if folder else ""
        death = NodeDeath(
            _COUNT.sub("", process_name).strip("/"),
            process.pid,
            exit_code,
            log,
            respawns=bool(process.respawn) and not process.required,
            time=time.time(),
        )
        return written(death)
