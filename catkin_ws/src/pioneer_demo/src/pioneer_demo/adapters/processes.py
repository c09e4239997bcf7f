"""The processes of a fleet: started on free ports, watched, accounted for, ended."""

import glob
import os
import re
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

from pioneer_demo.core.command import (
    FIRST_ROBOT_MASTER,
    HUB,
    HUB_GATEWAY_MASTER,
    HUB_MASTER,
    Ports,
    commands,
)
from pioneer_demo.core.cost import Cost
from pioneer_demo.core.kind import COMMAND, kind
from pioneer_demo.core.launch_log import NodeDeath, node_deaths, restarted_nodes
from pioneer_demo.core.option import FleetConfig
from pioneer_harness.accounting import Account
from pioneer_harness.error import ProcessDiedError
from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup, last_lines

# A Python process of a fleet does one thing at a time; threads of its matrix library would only get in others' way.
_SINGLE = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
_LAST_GRACE = 3.0
_RESTART = 10.0
"""Within which roslaunch starts a node again [s]: launch files have it wait 2 s."""


class FleetProcesses:
    """All processes of one fleet. To be used from the main thread only, as a context manager."""

    def __init__(self, config: FleetConfig) -> None:
        self._config, self._log = config, config.log
        self._reservation = PortReservation()
        self.ports = _ports(self._reservation, config.robots)
        self.group = ProcessGroup()
        self._account = Account(kind, short=COMMAND)
        self._read: dict[Path, int] = {}
        self._dead: dict[tuple[Path, str], tuple[float, str]] = {}

    def start(self) -> None:
        """Starts everything at once; the parts wait for each other.

        Raises:
            ProcessStartError: a command cannot be found.
        """
        self._log.mkdir(exist_ok=True)
        shutil.rmtree(self._log / "ros", ignore_errors=True)  # the last run's
        # Absolute: some nodes run in another directory.
        ros = self._log.resolve() / "ros"
        home = {"ROS_HOME": str(ros), "ROS_LOG_DIR": str(ros / "log")}
        for command in commands(self._config, self.ports):
            log = self._log / f"{re.sub(r'[^A-Za-z0-9_]+', '-', command.name)}.log"
            log.write_bytes(b"")
            self._read[log] = 0
            environment = {**_SINGLE, **os.environ, **home, **command.environment}
            self.group.start(command.name, _found(command.argv), environment, log)

    def check(self) -> list[str]:
        """Returns a line for each node that has died and is started again, where nodes may.

        Raises:
            ProcessDiedError: another process has ended that was to live, a node under roslaunch included.
        """
        self.group.check()
        lines = []
        for log in self._read:
            news = self._news(log)
            for death in node_deaths(news):
                self._dead[log, death.name] = time.monotonic(), _told(death, log)
            for name in restarted_nodes(news):
                lines.append(f"{name} has died and is started again")
                self._dead.pop((log, name), None)
        patience = _RESTART if self._config.restarts_nodes else 0.0
        for died, text in self._dead.values():
            if time.monotonic() - died >= patience:
                raise ProcessDiedError(text)
        return lines

    def sample(self) -> None:
        """Takes in what the processes have used so far."""
        self.group.sample(self._account)

    def costs(self) -> dict[str, Cost]:
        """Returns what each kind of process has cost up to the last sample, this process included."""
        user, system, *_ = os.times()
        rss = int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        usage = {name: Cost(used.cpu, used.rss, used.processes) for name, used in self._account.usage().items()}
        return {**usage, "this command": Cost(user + system, rss, 1)}

    def cpu(self) -> float:
        """Returns the CPU time of everything so far [s], this process included."""
        self.sample()
        return sum(cost.cpu for cost in self.costs().values())

    def stop(self, grace: float, urgent: Callable[[], bool]) -> tuple[str, ...]:
        """Ends everything within ``grace`` [s] and a moment; at once when ``urgent`` becomes true.

        Returns:
            The command lines of what had to be killed.
        """
        killed = self.group.stop(grace, urgent)
        self._reservation.release()
        return killed

    def __enter__(self) -> "FleetProcesses":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop(_LAST_GRACE, lambda: False)

    def _news(self, log: Path) -> str:
        """Returns what was appended to ``log`` since the last call, whole lines only."""
        with log.open("rb") as file:
            file.seek(self._read[log])
            text, newline, _ = file.read().rpartition(b"\n")
        self._read[log] += len(text) + len(newline)
        return text.decode(errors="replace")


def _found(argv: Sequence[str]) -> Sequence[str]:
    """Returns a command line that starts a workspace's program directly: rosrun takes ten processes to find it."""
    if argv[0] == "rosrun":
        for prefix in os.environ.get("CMAKE_PREFIX_PATH", "").split(os.pathsep):
            if (path := Path(prefix, "lib", *argv[1:3])).is_file():
                return [str(path), *argv[3:]]
    return argv


def _ports(reservation: PortReservation, robots: int) -> Ports:
    return Ports(
        hub=reservation.take(HUB),
        hub_master=reservation.take(HUB_MASTER),
        hub_gateway_master=reservation.take(HUB_GATEWAY_MASTER),
        robot_masters=tuple(reservation.take(FIRST_ROBOT_MASTER + index) for index in range(robots)),
    )


def _told(death: NodeDeath, launch_log: Path) -> str:
    how = "" if death.status is None else f", exit code {death.status}"
    logs = [Path(name) for name in sorted(glob.glob(death.log))] if death.log else []
    # What goes to the screen, a traceback say, is in roslaunch's own output; the rest in the node's file.
    ends = ((path, last_lines(path)) for path in [*logs, launch_log])
    text = "\n".join(f"  the last lines of {path}:\n{lines}" for path, lines in ends if lines)
    return f"{death.name} (pid {death.pid}) has died{how}\n{text}"
