"""Fleets of containers for tests, in their own project and subnet, beside other fleets."""

import contextlib
import fcntl
import json
import os
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from containers.engine import Computer, output
from containers.report import REPORT
from containers.state import fleet as fleet_of

ROOT = Path(__file__).parents[2]
PATIENCE = 240.0
"""Time-out for any wait [s]; generous, because the machine may be busy with other work."""

CPU_SCRIPT = "cat /sys/fs/cgroup/cpu.stat /sys/fs/cgroup/cpuacct/cpuacct.usage 2>/dev/null; true"
"""Shell script, run in a container, that prints the container's CPU time."""

END = "."
"""The line that ends each answer in `Fleet.asked`."""


class Fleet:
    """A project managed by ``./pioneer``; its containers are always removed at the end."""

    def __init__(self, project: str, subnet: str, **variables: str) -> None:
        self.environment = {**os.environ, "PIONEER_PROJECT": project, "PIONEER_SUBNET": subnet, **variables}
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

    def refused(self, *words: str, **variables: str) -> str:
        """Runs ``./pioneer``, expects it to fail, and returns its one-line error message."""
        environment = {**self.environment, **variables}
        done = subprocess.run([ROOT / "pioneer", *words], env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 1, done.stdout + done.stderr
        (line,) = done.stderr.splitlines()
        return line

    def logs(self) -> str:
        """Returns the last lines of every container."""
        found = []
        for name, one in self.computers().items():
            command = [*one.docker, "logs", "--tail", "40", one.container]
            done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
            found.append(f"--- {name} ({one.state}, {one.health})\n{done.stdout}")
        return "\n".join(found)

    def computers(self) -> dict[str, Computer]:
        """Returns the containers by computer name."""
        return {one.name: one for one in fleet_of(self.project).computers()}

    def container(self, computer: str) -> str:
        """Returns a computer's container."""
        return self.computers()[computer].container

    def docker(self, verb: str, computer: str, *words: str) -> str:
        """Runs ``docker VERB WORDS CONTAINER``."""
        one = self.computers()[computer]
        return output(*one.docker, verb, *words, one.container)

    def execute(self, computer: str, *command: str) -> str:
        """Runs a command on a computer and returns its output; raises ContainerError if it fails."""
        one = self.computers()[computer]
        return output(*one.docker, "exec", one.container, *command)

    @contextlib.contextmanager
    def meanwhile(self, computer: str, *command: str) -> Iterator[Callable[[], str]]:
        """Runs a command in the background; yields a function that waits for its end and returns its output.

        The function fails if the command fails.
        """
        one = self.computers()[computer]
        words = [*one.docker, "exec", one.container, *command]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:

            def result() -> str:
                said, _ = process.communicate(timeout=PATIENCE)
                assert process.returncode == 0, said[-3000:]
                return said

            try:
                yield result
            finally:
                process.kill()

    @contextlib.contextmanager
    def asked(self, computer: str, *command: str) -> Iterator[Callable[[], str]]:
        """Runs a command in the background; yields a function that sends a line and returns the output up to `END`."""
        one = self.computers()[computer]
        words = [*one.docker, "exec", "-i", one.container, *command]
        with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
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

    def network(self, verb: str, computer: str, *words: str) -> None:
        """Runs ``docker network VERB WORDS`` for a computer and the shared network."""
        output("docker", "network", verb, *words, f"{self.project}_aadi.robots", self.container(computer))

    def send(self, number: int, x: float, y: float, heading: float = 0.0) -> None:
        """Sends a waypoint in the way that the tutorial documents."""
        self.execute(
            f"aadi{number}", "rostopic", "pub", "-1", f"/pioneer{number}/map_goal", "geometry_msgs/Twist",
            f"[{x}, {y}, 0.0]", f"[0.0, 0.0, {heading}]",
        )  # fmt: skip

    def report(self, computer: str, *words: str, timeout: float = PATIENCE) -> dict[str, Any]:
        """Returns a computer's last report; fails if it does not reach the state that ``words`` ask for."""
        one = self.computers()[computer]
        command = [*one.docker, "exec", one.container, *REPORT, "--robot", one.robot]
        done = subprocess.run(
            [*command, "--settled", "--timeout", f"{timeout:g}", *words], capture_output=True, text=True, check=False
        )
        last = json.loads(done.stdout.splitlines()[-1]) if done.stdout.strip() else {}
        assert done.returncode == 0, f"{computer}: {last or done.stderr[-2000:]}\n{self.logs()}"
        return last

    def arrived(self, numbers: Sequence[int], count: dict[int, int]) -> dict[int, dict[str, Any]]:
        """Waits until each robot has reached or given up ``count`` waypoints; returns the reports."""
        results: dict[int, Any] = {}

        def wait(number: int) -> None:
            with contextlib.suppress(AssertionError):
                words = ("--until", "ready", "--arrived", str(count[number]))
                results[number] = self.report(f"aadi{number}", *words)

        threads = [threading.Thread(target=wait, args=(number,)) for number in numbers]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        missing = [number for number in numbers if number not in results]
        assert not missing, f"robots {missing} have not arrived:\n{self.pioneer('status')}"
        return results

    def memory(self, computer: str) -> float:
        """Returns the memory of a computer's processes [bytes], without the kernel's page cache."""
        pids = self.execute(computer, "sh", "-c", "cat /proc/[0-9]*/smaps_rollup 2>/dev/null; true")
        return sum(int(line.split()[1]) for line in pids.splitlines() if line.startswith("Pss:")) * 1024.0

    def cpu_seconds(self) -> float:
        """Returns the CPU time used by all containers [s]."""
        return sum(cpu_of(self.execute(name, "sh", "-c", CPU_SCRIPT)) for name in self.computers())


def cpu_of(text: str) -> float:
    """Returns the last CPU time [s] printed by `CPU_SCRIPT`."""
    for line in text.splitlines():
        if line.startswith("usage_usec"):
            return int(line.split()[1]) / 1e6
    return int(text.split()[-1]) / 1e9


@contextlib.contextmanager
def fleet(project: str, subnet: str, **variables: str) -> Iterator[Fleet]:
    """Provides a fleet; removes what an interrupted run left of it, and waits for tests of other checkouts."""
    made = Fleet(project, subnet, **variables)
    with (Path(tempfile.gettempdir()) / f"{project}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        made.pioneer("down")
        try:
            yield made
        finally:
            made.pioneer("down")
