"""Fleets of containers for measurements and tests, in their own project and subnet, beside other fleets."""

import contextlib
import fcntl
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from containers.engine import Computer, output
from containers.state import fleet as fleet_of

ROOT = Path(__file__).parents[2]
CPU_SCRIPT = "cat /sys/fs/cgroup/cpu.stat /sys/fs/cgroup/cpuacct/cpuacct.usage 2>/dev/null; true"
"""Shell script, run in a container, that prints the container's CPU time."""

END = "."
"""The line that ends each answer in `Fleet.asked`."""

AnyFleet = TypeVar("AnyFleet", bound="Fleet")


class Fleet:
    """A project managed by ``./pioneer``; its containers are always removed at the end."""

    def __init__(self, project: str, subnet: str, **variables: str) -> None:
        self.environment = {
            **os.environ,
            "PIONEER_PROJECT": project,
            "PIONEER_SUBNET": subnet,
            **variables,
        }
        self.project = project

    def pioneer(self, *words: str) -> str:
        """Runs ``./pioneer`` and returns its output; fails with that output if the command fails."""
        done = subprocess.run(
            [ROOT / "pioneer", *words],
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=1200.0,
        )
        said = f"./pioneer {' '.join(words)}:\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
        assert done.returncode == 0, f"{said}\n{self.logs()}"
        return done.stdout

    def logs(self) -> str:
        """Returns the last lines of every container."""
        found = []
        for name, one in self.computers().items():
            command = [*one.docker, "logs", "--tail", "40", one.container]
            done = subprocess.run(
                command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
            )
            found.append(f"--- {name} ({one.state}, {one.health})\n{done.stdout}")
        return "\n".join(found)

    def computers(self) -> dict[str, Computer]:
        """Returns the containers by computer name."""
        return {one.name: one for one in fleet_of(self.project).computers()}

    def execute(self, computer: str, *command: str) -> str:
        """Runs a command on a computer and returns its output; raises ContainerError if it fails."""
        one = self.computers()[computer]
        return output(*one.docker, "exec", one.container, *command)

    @contextlib.contextmanager
    def asked(self, computer: str, *command: str) -> Iterator[Callable[[], str]]:
        """Runs a command in the background; yields a function that sends a line and returns the output up to `END`."""
        one = self.computers()[computer]
        words = [*one.docker, "exec", "-i", one.container, *command]
        with subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdin
            assert process.stdout
            asking, answers = process.stdin, process.stdout

            def answer() -> str:
                print(file=asking, flush=True)
                said = ""
                for line in answers:
                    if line == f"{END}\n":
                        return said
                    said += line
                raise AssertionError(f"{computer}: {' '.join(command)} has ended; it said {said!r}")

            yield answer

    def memory(self, computer: str) -> float:
        """Returns the memory of a computer's processes [bytes], without the kernel's page cache."""
        pids = self.execute(computer, "sh", "-c", "cat /proc/[0-9]*/smaps_rollup 2>/dev/null; true")
        return (
            sum(int(line.split()[1]) for line in pids.splitlines() if line.startswith("Pss:"))
            * 1024.0
        )


def cpu_of(text: str) -> float:
    """Returns the last CPU time [s] printed by `CPU_SCRIPT`."""
    for line in text.splitlines():
        if line.startswith("usage_usec"):
            return int(line.split()[1]) / 1e6
    return int(text.split()[-1]) / 1e9


@contextlib.contextmanager
def started(made: AnyFleet) -> Iterator[AnyFleet]:
    """Provides a fleet; removes what an interrupted run left of it, and waits for runs in other checkouts."""
    with (Path(tempfile.gettempdir()) / f"{made.project}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        made.pioneer("down")
        try:
            yield made
        finally:
            made.pioneer("down")
