"""The Docker engine and Compose, called through their command lines."""

import contextlib
import fcntl
import json
import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

DOCKER = ("docker",)
"""The command that controls this machine's engine."""
DESKTOP, WEB, ROS2 = "desktop", "web", "ros2"
EXTRAS = (DESKTOP, WEB, ROS2)
"""Services, named like their profiles, whose containers are not computers but share the base station's network."""
PAGES = {DESKTOP: 6080, WEB: 8090}
"""Those with a page, and its port."""


class ContainerError(Exception):
    """A container problem, described in one line."""


def say(text: str) -> None:
    """Prints a line at once, even into a pipe."""
    print(text, flush=True)


def compose_command() -> list[str]:
    """Returns the Compose command, after checking the engine.

    Raises:
        ContainerError: one of them is missing or does not answer; the line says what to install.
    """
    if shutil.which("docker") is None:
        raise ContainerError("Docker is missing: apt install docker.io docker-compose")
    answer = _run(["docker", "version", "--format", "{{.Server.Version}}"])
    if answer.returncode:
        why = (answer.stderr.strip() or answer.stdout.strip()).splitlines()
        raise ContainerError(
            f"the Docker engine does not answer ({why[-1] if why else 'no reason given'}): is it running, "
            "and may you use it (group docker)?"
        )
    if not _run(["docker", "compose", "version"]).returncode:
        return ["docker", "compose"]
    if shutil.which("docker-compose"):
        return ["docker-compose"]
    raise ContainerError("Docker Compose is missing: apt install docker-compose")


def _run(command: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(command, capture_output=True, text=True, check=False)


def output(*command: str) -> str:
    """Returns what a command prints.

    Raises:
        ContainerError: it failed, with its last line.
    """
    answer = _run(command)
    if answer.returncode:
        lines = (answer.stderr.strip() or answer.stdout.strip() or "no reason given").splitlines()
        raise ContainerError(f"{' '.join(command[:3])} failed: {lines[-1]}")
    return answer.stdout


_PATIENCE = "600"
"""Time-out of docker-compose for the engine [s]: 60 s were too short on a machine that starts or ends a fleet."""


@dataclass(frozen=True)
class Computer:
    """A container of the fleet."""

    name: str  #: of the service
    container: str  #: id of the container
    state: str  #: as Docker reports it; in a swarm, that of the task
    health: str  #: likewise; empty in a swarm, where a task counts as running once it is healthy
    environment: Mapping[str, str]  #: environment of its processes
    image: str  #: name of its image
    node: str = ""  #: the swarm node it runs on; empty without a swarm
    docker: tuple[str, ...] = DOCKER  #: the command that controls its engine
    task: str = ""  #: id of the swarm task
    problem: str = ""  #: why the swarm does not run it

    @property
    def running(self) -> bool:
        """Whether it is running."""
        return self.state == "running"

    @property
    def number(self) -> int:
        """The X in aadiX; 0 for the base station."""
        return int(self.name[4:]) if self.name[4:].isdigit() else 0

    @property
    def robot(self) -> str:
        """The robot driven from it; empty for the base station."""
        return f"pioneer{self.number}" if self.number else ""


@dataclass(frozen=True)
class Project:
    """One fleet: the name of a Compose project, its file, and the values of the file's variables."""

    name: str
    compose: tuple[str, ...]
    file: Path
    variables: Mapping[str, str]
    lock: Path | None = None  #: held while Compose changes the fleet; None: nobody else changes it

    def run(self, *arguments: str) -> None:
        """Runs Compose, after other calls that change this fleet; its output goes to ours.

        Raises:
            ContainerError: it failed.
        """
        with self.alone():
            self._compose(*arguments)

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Waits until no other call of Compose changes this fleet, and excludes further ones meanwhile.

        Compose inherits the lock: after ``./pioneer`` has been killed, its Compose may still start containers.
        """
        if self.lock is None:
            yield
            return
        with self._opened_lock(self.lock) as file:
            os.set_inheritable(file.fileno(), True)
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                say(f"waiting for another call that changes this fleet (fuser {self.lock}) …")
                fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def _opened_lock(self, path: Path) -> IO[str]:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            return path.open("w")
        except OSError as error:
            raise ContainerError(f"cannot write {path}: {error.strerror}") from None

    def _compose(self, *arguments: str) -> None:
        command = [*self.compose, "-p", self.name, "-f", str(self.file), *arguments]
        environment = {"COMPOSE_HTTP_TIMEOUT": _PATIENCE, **os.environ, **self.variables}
        # Of our descriptors, only the lock can be inherited.
        status = subprocess.run(command, env=environment, check=False, close_fds=False).returncode
        if status:
            raise ContainerError(
                f"compose {arguments[0]} failed with exit status {status}; the lines above say why"
            )

    def down(self) -> None:
        """Ends and removes the containers, the volumes of their logs, and the network."""
        words = "down", "--remove-orphans", "--volumes"
        try:
            self.run(*words)
        except ContainerError:
            # For a moment Docker may still count a removed container as part of the network; by now it no longer does.
            self.run(*words)

    def logs(self, follow: bool, names: Sequence[str]) -> None:
        """Prints the logs of the named computers, by default of all; with ``follow``, until Ctrl-C."""
        self._compose("logs", *(["-f"] if follow else []), *names)

    def runs(self, service: str) -> bool:
        """Returns whether a container of the service runs."""
        labels = (f"project={self.name}", f"service={service}")
        filters = [
            word for label in labels for word in ("--filter", f"label=com.docker.compose.{label}")
        ]
        return bool(output("docker", "ps", "-q", *filters).strip())

    def computers(self) -> list[Computer]:
        """Returns the project's computers: the base station first, then robots by number; without `EXTRAS`."""
        ids = output(
            "docker", "ps", "-aq", "--filter", f"label=com.docker.compose.project={self.name}"
        ).split()
        facts = json.loads(output("docker", "inspect", *ids)) if ids else []
        return sorted(
            (one for one in map(_computer, facts) if one.name not in EXTRAS),
            key=lambda one: one.number,
        )


def _computer(fact: Mapping[str, Any]) -> Computer:
    state, config = fact["State"], fact["Config"]
    return Computer(
        config["Labels"]["com.docker.compose.service"],
        fact["Id"],
        state["Status"],
        state.get("Health", {}).get("Status", ""),
        dict(line.split("=", 1) for line in config["Env"]),
        fact["Image"],
    )
