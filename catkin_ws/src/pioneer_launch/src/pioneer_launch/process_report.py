"""Deaths of nodes, as roslaunch's process monitor reports them, in a file of JSON lines for another process.

It works with the switch off, too: those who started a fleet must know which node has died.
"""

import dataclasses
import json
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

REPORT = "PIONEER_PROCESS_REPORT"
"""Variable: the file to which a launcher appends the deaths of its nodes; none if it is not set."""
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


def written(death: NodeDeath) -> str:
    """Returns a death as one line of JSON."""
    return json.dumps(dataclasses.asdict(death)) + "\n"


def deaths_in(text: str) -> Iterator[NodeDeath]:
    """Yields the deaths in complete lines of a report."""
    for line in text.splitlines():
        yield NodeDeath(**json.loads(line))


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
            monitor.add_process_listener(_Listener(monitor, path))
        return monitor

    pmon.start_process_monitor = start_process_monitor


class _Listener:
    """Has the methods of ``roslaunch.pmon.ProcessListener``."""

    def __init__(self, monitor: Any, path: Path) -> None:
        self._monitor, self._path = monitor, path
        self._reported: dict[str, int] = {}

    def process_died(self, process_name: str, exit_code: int | None) -> None:
        """Appends the death, once: roslaunch calls this again and again until it starts the node again."""
        process = self._monitor.get_process(process_name)
        if process is None or exit_code == 0:
            return
        if self._reported.get(process_name) == process.spawn_count:
            return
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
        with self._path.open("a") as report:
            report.write(written(death))
