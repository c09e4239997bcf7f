"""Manages a fleet's processes: starts them on free ports, monitors, accounts for and ends them."""

import contextlib
import glob
import os
import re
import shutil
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pioneer_demo.processes import leftover
from pioneer_demo.processes.command import (
    Command,
    Ports,
    commands,
    restarted_together,
    started_again,
)
from pioneer_demo.processes.kind import COMMAND, kind
from pioneer_demo.processes.network import Networks
from pioneer_demo.processes.relapse import Relapses, ending
from pioneer_demo.scenario.option import FleetConfig
from pioneer_harness.accounting import Account, Usage
from pioneer_harness.error import ProcessDiedError
from pioneer_harness.port import PortReservation
from pioneer_harness.proc import arguments, descendants, has_variable
from pioneer_harness.process import Death, ProcessGroup, last_lines
from pioneer_harness.wait import wait_until
from pioneer_launch import door

# Python nodes work sequentially; BLAS threads would only compete with other processes.
_SINGLE = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
_LAST_GRACE = 3.0
_KILLED = 10.0
"""Time-out for the end of killed processes [s]."""
_FULL = 1 << 16
"""Less free space than this is none [bytes]."""
_COLOUR = re.compile(r"\x1b(\[[0-9;]*m|\]2;[^\x07]*\x07)")
"""Matches escape codes for colours and window titles."""
_ERROR = re.compile(r"\b(FATAL|CRITICAL|ERROR|\w*Error)\b")
"""Matches log lines that report why a node ends."""


class FleetProcesses:
    """All processes of one fleet; a context manager. Use it from the main thread only."""

    def __init__(self, config: FleetConfig) -> None:
        self._config, self._log = config, config.log
        self._reservation = PortReservation()
        self.ports = Ports.taken(config.robots, self._reservation.take)
        self.networks = Networks(config.linked, self.ports.hub)
        self.group = ProcessGroup()
        self._account = Account(kind, short=COMMAND)
        self._read: dict[Path, int] = {}
        self._pids: dict[str, int] = {}
        self._dead: dict[tuple[Path, str], str] = {}
        self._relapses = Relapses()
        #: commands with a node that died and did not start again, with the reason; the caller clears it
        self.lost_computers: dict[str, str] = {}

    def start(self) -> None:
        """Starts all processes at once; they wait for each other.

        Raises:
            ProcessStartError: a command cannot be found.
        """
        self._log.mkdir(exist_ok=True)
        shutil.rmtree(self._log / "ros", ignore_errors=True)  # left by the previous run
        # Absolute: some nodes run in another directory.
        for command in commands(self._config, self.ports):
            log = self._log_of(command)
            log.write_bytes(b"")
            report = _report_of(log)
            door.begin_report(report)
            self._read[report] = 0
            self._start(command)

    def kill(self, names: Sequence[str]) -> None:
        """Kills these commands and all their descendants with SIGKILL."""
        for name in names:
            self.group.kill(name)

    def restart(self, names: Sequence[str]) -> None:
        """Starts killed commands again."""
        for command in commands(self._config, self.ports):
            if command.name in names:
                log = self._log_of(command)
                self._dead = {key: text for key, text in self._dead.items() if key[0] != log}
                self._start(started_again(command))

    def kill_computer(self, names: Sequence[str]) -> None:
        """Kills what is left of commands that run on one computer, also nodes whose launcher has ended.

        Raises:
            WaitError: a process does not end.
        """
        self.kill(names)
        masters = {
            command.environment["ROS_MASTER_URI"]
            for command in commands(self._config, self.ports)
            if command.name in names and "ROS_MASTER_URI" in command.environment
        }

        def left() -> list[int]:
            return [
                state.pid
                for state in self.group.states().values()
                if state.alive
                and any(has_variable(state.pid, "ROS_MASTER_URI", uri) for uri in masters)
            ]

        for pid in left():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        wait_until(lambda: not left(), "the end of killed processes", _KILLED)

    def freeze(self, name: str, frozen: bool) -> None:
        """Suspends (SIGSTOP) or resumes (SIGCONT) the gateway that a command has started."""
        for pid in descendants(self.group.states(), {self._pids[name]}):
            if "__name:=gateway" in arguments(pid):
                os.kill(pid, signal.SIGSTOP if frozen else signal.SIGCONT)

    def run(self, name: str, argv: Sequence[str], environment: Mapping[str, str]) -> None:
        """Starts a command that exits by itself."""
        self._start(Command(name, tuple(argv), environment), may_end=True)

    def _start(self, command: Command, may_end: bool = False) -> None:
        ros = self._log.resolve() / "ros"
        home = {"ROS_HOME": str(ros), "ROS_LOG_DIR": str(ros / "log")}
        robot = command.environment.get("ROBOT_NAME", "")
        log = self._log_of(command)
        environment = {
            **_SINGLE,
            **os.environ,
            **home,
            leftover.VARIABLE: leftover.mark(),
            door.REPORT: str(_report_of(log).absolute()),
            **command.environment,
            **self.networks.environment(robot),
        }
        argv = self.networks.placed(robot, door.resolved(command.argv))
        self._pids[command.name] = self.group.start(command.name, argv, environment, log, may_end)

    def _log_of(self, command: Command) -> Path:
        return self._log / f"{re.sub(r'[^A-Za-z0-9_]+', '-', command.name)}.log"

    def check(self, starting: bool = False) -> list[str]:
        """Checks the processes; returns a line for each node that died and is respawned, if respawns are allowed.

        A node that keeps dying is reported once, with its last lines of output, and again when it has recovered. The
        other nodes keep running.

        Args:
            starting: the fleet is still starting, so a node that keeps dying is an error.

        Raises:
            ProcessDiedError: a process, or a node under roslaunch, has ended unexpectedly.
        """
        lines = self._relapses.recovered(time.monotonic())
        for report in self._read:
            log = _log_of_report(report)
            for death in door.deaths_in(self._news(report)):
                lines += self._noted(death, log, starting)
        self._check_group()
        for (log, _), text in list(self._dead.items()):
            command = self._command_of(log)
            if starting or not restarted_together(self._config, command):
                raise ProcessDiedError(text)
            self.lost_computers[command] = text.partition("\n")[0]
        return lines

    def _noted(self, death: door.NodeDeath, log: Path, starting: bool) -> list[str]:
        """Notes a node's death; returns the line about it, if there is one."""
        key = (log, death.name)
        text, reason = _told(death, log)
        if not (death.respawns and self._config.restarts_nodes):
            self._dead[key] = text
            return []
        if self._relapses.died(key, death.name, reason, time.monotonic()):
            text = f"{death.name} keeps dying; the last time: {text}"
            if starting:
                raise ProcessDiedError(text)
            return [text]
        if self._relapses.fails(key):
            return []
        return [f"{death.name} has died and is started again"]

    def _check_group(self) -> None:
        """Raises ``ProcessDiedError`` if a command has ended; names its node that has died, if there is one."""
        for death in self.group.deaths:
            cause = self.cause(death)
            raise ProcessDiedError(f"{death.headline}: {cause}" if cause else str(death))

    def cause(self, death: Death) -> str:
        """Returns which node's death has ended a command, with its last lines; empty if none has died."""
        told = [text for (log, _), text in self._dead.items() if log == death.log]
        return told[-1] if told else ""

    def _command_of(self, log: Path) -> str:
        every = commands(self._config, self.ports)
        return next((command.name for command in every if self._log_of(command) == log), "")

    def faults(self) -> list[str]:
        """Returns a line for each node that keeps dying, and one if the disk with the logs is full."""
        return [*self._relapses.faults(), *_full_disk(self._log)]

    def sample(self) -> None:
        """Samples the resource usage of the processes."""
        self.group.sample(self._account)

    def costs(self) -> dict[str, Usage]:
        """Returns the cost by kind of process up to the last sample, including this process."""
        user, system, *_ = os.times()
        rss = int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        return {**self._account.usage(), "this command": Usage(user + system, rss, 1)}

    def cpu(self) -> float:
        """Returns the total CPU time so far [s], including this process."""
        self.sample()
        return sum(cost.cpu for cost in self.costs().values())

    def stop(self, grace: float, urgent: Callable[[], bool]) -> tuple[str, ...]:
        """Ends everything within about ``grace`` [s], or at once when ``urgent`` returns true.

        Returns:
            The command lines of the processes that had to be killed.
        """
        killed = self.group.stop(grace, urgent)
        self.networks.close()
        self._reservation.release()
        return killed

    def __enter__(self) -> "FleetProcesses":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop(_LAST_GRACE, lambda: False)

    def _news(self, report: Path) -> str:
        """Returns the complete lines appended to ``report`` since the last call."""
        with report.open("rb") as file:
            file.seek(self._read[report])
            text, newline, _ = file.read().rpartition(b"\n")
        self._read[report] += len(text) + len(newline)
        return text.decode()


def _full_disk(folder: Path) -> list[str]:
    """Returns a line about the disk with this folder if it is full."""
    try:
        is_full = shutil.disk_usage(folder).free < _FULL
    except OSError:
        return []
    return [f"the disk with {folder} is full: log lines and recordings are lost"] if is_full else []


def _report_of(log: Path) -> Path:
    """Returns the file beside a command's log to which its roslaunch reports the deaths of nodes."""
    return log.with_suffix(".deaths.jsonl")


def _log_of_report(report: Path) -> Path:
    return report.with_name(report.name.removesuffix(".deaths.jsonl") + ".log")


def _told(death: door.NodeDeath, launch_log: Path) -> tuple[str, str]:
    """Returns a node's death with the last lines of its logs, and one line: its exit code and the last error."""
    # Screen output, such as a traceback, is in roslaunch's own log; the rest is in the node's log file.
    ends = {
        path: last_lines(path) for path in [*map(Path, sorted(glob.glob(death.log))), launch_log]
    }
    how = "" if death.status is None else f", {ending(death.status)}"
    text = "\n".join(
        f"  the last lines of {path}:\n{lines}" for path, lines in ends.items() if lines
    )
    reason = how.removeprefix(", ") or "no exit code"
    errors = [
        _COLOUR.sub("", line).strip()
        for line in "\n".join(ends.values()).splitlines()
        if _ERROR.search(line)
    ]
    return (
        f"{death.name} (pid {death.pid}) has died{how}\n{text}",
        f"{reason}: {errors[-1]}" if errors else reason,
    )
