"""Fleets of containers for tests: what tests ask of a fleet beyond measuring it."""

import contextlib
import json
import subprocess
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from containers import harness
from containers.engine import output
from containers.harness import CPU_SCRIPT, ROOT, cpu_of, started
from containers.hosts import Host
from containers.report import REPORT
from containers.swarm import BASE_LABEL

PATIENCE = 240.0
"""Time-out for any wait [s]; generous, because the machine may be busy with other work."""


class Fleet(harness.Fleet):
    """A project managed by ``./pioneer``, whose computers are also asked, faulted and awaited."""

    def refused(self, *words: str, **variables: str) -> str:
        """Runs ``./pioneer``, expects it to fail, and returns its one-line error message."""
        environment = {**self.environment, **variables}
        done = subprocess.run(
            [ROOT / "pioneer", *words], env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 1, done.stdout + done.stderr
        (line,) = done.stderr.splitlines()
        return line

    def container(self, computer: str) -> str:
        """Returns a computer's container."""
        return self.computers()[computer].container

    def docker(self, verb: str, computer: str, *words: str) -> str:
        """Runs ``docker VERB WORDS CONTAINER``."""
        one = self.computers()[computer]
        return output(*one.docker, verb, *words, one.container)

    @contextlib.contextmanager
    def meanwhile(self, computer: str, *command: str) -> Iterator[Callable[[], str]]:
        """Runs a command in the background; yields a function that waits for its end and returns its output.

        The function fails if the command fails.
        """
        one = self.computers()[computer]
        words = [*one.docker, "exec", one.container, *command]
        with subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        ) as process:

            def result() -> str:
                said, _ = process.communicate(timeout=PATIENCE)
                assert process.returncode == 0, said[-3000:]
                return said

            try:
                yield result
            finally:
                process.kill()

    def network(self, verb: str, computer: str, *words: str) -> None:
        """Runs ``docker network VERB WORDS`` for a computer and the shared network."""
        output(
            "docker",
            "network",
            verb,
            *words,
            f"{self.project}_aadi.robots",
            self.container(computer),
        )

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
            [*command, "--settled", "--timeout", f"{timeout:g}", *words],
            capture_output=True,
            text=True,
            check=False,
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

    def cpu_seconds(self) -> float:
        """Returns the CPU time used by all containers [s]."""
        return sum(cpu_of(self.execute(name, "sh", "-c", CPU_SCRIPT)) for name in self.computers())


def may_have_base(host: Host) -> None:
    """Labels a host so that the base station may run there."""
    output("docker", "node", "update", "--label-add", f"{BASE_LABEL}=base", host.name)


def cut(host: Host) -> None:
    """Disconnects a host's network cable."""
    output("ip", "link", "set", host.link, "down")


def mend(host: Host) -> None:
    """Reconnects a host's network cable."""
    output("ip", "link", "set", host.link, "up")


@contextlib.contextmanager
def fleet(project: str, subnet: str, **variables: str) -> Iterator[Fleet]:
    """Provides a fleet, and removes it at the end."""
    with started(Fleet(project, subnet, **variables)) as made:
        yield made
