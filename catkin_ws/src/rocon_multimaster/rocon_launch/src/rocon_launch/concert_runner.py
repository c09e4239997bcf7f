"""Runs all launches of a concert: starts them in order and stops them together."""

import os
import re
import signal
import sys
import threading
import time
from collections.abc import Sequence

import psutil

from pioneer_launch.door import launcher_starter
from pioneer_node.adapters.end_request import EndRequest
from rocon_launch.concert import Launch
from rocon_launch.roslaunch import RoslaunchProcess

GENTLE = 3.5
"""How long the launches may take to shut down before they are killed [s]."""


class ConcertRunner:
    """Runs launches until they all end, or until interrupted.

    Args:
        launches: the launches to run.
        screen: pass `--screen` to roslaunch.
        program: the roslaunch executable.
    """

    def __init__(
        self, launches: Sequence[Launch], screen: bool, program: str = "roslaunch"
    ) -> None:
        self._launches = launches
        self._screen = screen
        self._program = program
        self._stop = EndRequest()
        self._fork = launcher_starter()
        self._lock = threading.Lock()
        self._processes: list[RoslaunchProcess] = []
        self._told: list[RoslaunchProcess] = []

    def run(self) -> int:
        """Returns 0 after an interrupt or if all launches succeeded, otherwise the status of the first that failed.

        When a ``required`` launch ends, everything is stopped and the status is not 0. A ``respawn`` launch is
        restarted.
        """
        self._stop.take_signals(signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        try:
            for launch in self._launches:
                if not self._stop.is_set():
                    self._processes.append(self._start(launch))
            while not self._stop.wait(0.2):
                if self._look():
                    return next((p.status for p in self._processes if p.status), 1)
                if all(process in self._told for process in self._processes):
                    break
            return (
                0
                if self._stop.is_set()
                else next((p.status or 0 for p in self._processes if p.status), 0)
            )
        finally:
            self._end()

    def _look(self) -> bool:
        """Handles launches that have ended; returns whether the whole concert must stop."""
        for index, process in enumerate(self._processes):
            if process.status is None or process in self._told:
                continue
            launch, lived = process.launch, process.lived
            self._told.append(process)
            if launch.ends_all(lived):
                self._show(launch.title, f"has ended after {lived:.0f} s; everything ends with it")
                return True
            if launch.starts_again(lived):
                self._show(launch.title, f"has ended after {lived:.0f} s; starting it again")
                self._processes[index] = self._start(launch)
            else:
                self._show(
                    launch.title, f"has ended after {lived:.0f} s with status {process.status}"
                )
        return False

    def _start(self, launch: Launch) -> RoslaunchProcess:
        flags = [*(["--screen"] if self._screen else []), *(["--wait"] if launch.waits else [])]
        command = [self._program, "--no-summary", *flags, "-p", str(launch.port)]
        command += [*([launch.package] if launch.package else []), launch.name]
        command += [f"{name}:={value}" for name, value in launch.arguments.items()]
        return RoslaunchProcess(launch, command, _environment(launch), self._show, self._fork)

    def _show(self, title: str, line: str) -> None:
        with self._lock:
            sys.stdout.write(f"[{title}] {line}\n")
            sys.stdout.flush()

    def _end(self) -> None:
        """Interrupts all launches, waits, and kills the remaining processes, so that none is left behind."""
        descendants = {process.pid: _descendants(process.pid) for process in self._processes}
        for process in self._processes:
            process.interrupt()
        deadline = time.monotonic() + GENTLE
        for process in self._processes:
            process.wait(max(0.0, deadline - time.monotonic()))
            # A roslaunch that is interrupted while it starts a node may have it running only now.
            known = {*descendants[process.pid], *_descendants(process.pid)}
            left = [child.pid for child in known if child.is_running()]
            if process.status is None or left:
                process.kill(left)
            process.close()


def _descendants(pid: int) -> list[psutil.Process]:
    try:
        return psutil.Process(pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def _environment(launch: Launch) -> dict[str, str]:
    """Returns our environment with the launch's master, without the caller's ROS_NAMESPACE."""
    environment = {name: value for name, value in os.environ.items() if name != "ROS_NAMESPACE"}
    uri = environment.get("ROS_MASTER_URI") or "http://localhost:11311"
    host = re.sub(r"^[a-z]+://|[:/].*$", "", re.sub(r"^([a-z]+://)", "", uri)) or "localhost"
    environment["ROS_MASTER_URI"] = f"http://{host}:{launch.port}"
    environment["PYTHONUNBUFFERED"] = "1"
    return environment
