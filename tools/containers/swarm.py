"""Docker Swarm: its nodes, access to each node's engine, and a fleet as a stack."""

import json
import os
import subprocess
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from containers.engine import DOCKER, Computer, ContainerError, output

BASE_LABEL = "pioneer"
"""The node label whose value ``base`` marks where the base station may run."""
BASE, ROBOTS = "aadiworkstation", "aadi"
"""The stack's services; a robot's computer is a task of the second, aadi1 its first slot."""
LOOK = 1.0
"""Polling period [s]: the swarm's command line reports no changes."""
REMOVAL = 120.0
"""Time-out for the end of a stack's containers, which get 20 s [s]."""


@dataclass(frozen=True)
class Node:
    """A machine of the swarm."""

    name: str  #: host name
    ident: str  #: id in the swarm
    address: str  #: its address in the swarm
    up: bool  #: whether it is reachable
    works: bool  #: whether it is reachable and accepts tasks
    base: bool  #: whether it has the base station's label
    processors: float  #: number of processors
    docker: tuple[str, ...] = DOCKER  #: the command that controls its engine


def nodes() -> list[Node]:
    """Returns all nodes, this one first.

    Raises:
        ContainerError: this engine manages no swarm.
    """
    swarm = json.loads(output("docker", "info", "-f", "{{json .Swarm}}"))
    if not swarm.get("ControlAvailable"):
        raise ContainerError(
            "this engine is no manager of a swarm: docker swarm init --advertise-addr ADDRESS, then on each other "
            "machine the command that it prints; docs/several-hosts.md has more"
        )
    contexts = set(output("docker", "context", "ls", "-q").split())
    facts = _inspected("node", output("docker", "node", "ls", "-q").split())
    found = [_node(fact, swarm, contexts) for fact in facts]
    return sorted(found, key=lambda one: (one.docker != DOCKER, one.name))


def _inspected(kind: str, names: Sequence[str]) -> list[dict[str, Any]]:
    """Returns the engine's data on these objects of a kind, without those that have disappeared meanwhile."""
    if not names:
        return []
    command = ["docker", "inspect", "--type", kind, *names]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode and "no such" not in done.stderr.lower():
        raise ContainerError(f"docker inspect of {kind}s failed: {done.stderr.strip()}")
    return list(json.loads(done.stdout or "[]"))


def _node(fact: Mapping[str, Any], swarm: Mapping[str, Any], contexts: set[str]) -> Node:
    name, address = fact["Description"]["Hostname"], fact["Status"]["Addr"]
    here, up = fact["ID"] == swarm["NodeID"], fact["Status"]["State"] == "ready"
    other = (
        ("docker", "--context", name) if name in contexts else ("docker", "-H", f"ssh://{address}")
    )
    return Node(
        name,
        fact["ID"],
        swarm["NodeAddr"] if here else address,
        up,
        up and fact["Spec"]["Availability"] == "active",
        fact["Spec"].get("Labels", {}).get(BASE_LABEL) == "base",
        fact["Description"]["Resources"]["NanoCPUs"] / 1e9,
        DOCKER if here else other,
    )


def check_engines(found: Sequence[Node]) -> None:
    """Raises ContainerError for a node that accepts tasks but whose engine cannot be accessed."""
    for node in found:
        try:
            output(*node.docker, "version", "-f", "{{.Server.Version}}")
        except ContainerError as error:
            raise ContainerError(
                f"the engine of {node.name} does not answer ({error}); tell how to reach it, once: "
                f"docker context create {node.name} --docker host=ssh://USER@{node.address}"
            ) from None


def awaited(condition: Callable[[], bool], timeout: float) -> bool:
    """Polls the swarm until a condition holds, for at most ``timeout`` [s]; returns whether it does."""
    deadline, pause = time.monotonic() + timeout, threading.Event()
    while not condition():
        if time.monotonic() >= deadline:
            return False
        pause.wait(LOOK)
    return True


@dataclass(frozen=True)
class Stack:
    """One fleet as a stack: its name, and the file that it was deployed from."""

    name: str
    file: Path

    def deploy(self, **variables: str) -> None:
        """Deploys the file with these values of its ``variables``.

        Raises:
            ContainerError: it failed.
        """
        command = ["docker", "stack", "deploy", "-c", str(self.file), "--resolve-image", "never"]
        environment = {**os.environ, **variables}
        done = subprocess.run(
            [*command, "--with-registry-auth", self.name],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise ContainerError(f"docker stack deploy failed: {done.stderr.strip()}")

    def scale(self, robots: int) -> None:
        """Sets the number of robots' computers; leaves running ones alone."""
        output("docker", "service", "scale", "-d", f"{self.name}_{ROBOTS}={robots}")

    def update(self, image: str) -> None:
        """Updates the robots' computers to another image, one at a time; returns once the last one runs."""
        command = [
            "docker",
            "service",
            "update",
            "-q",
            "--with-registry-auth",
            "--no-resolve-image",
        ]
        output(*command, "--image", image, f"{self.name}_{ROBOTS}")

    def computers(self) -> list[Computer]:
        """Returns the fleet's computers, the base station first, then robots by number."""
        return self.tasks()[0]

    def tasks(self) -> tuple[list[Computer], list[Computer]]:
        """Returns the fleet's computers, and the latest tasks that a node could not start, e.g. without the image."""
        services = self._services()
        listed = (
            output("docker", "service", "ps", "--no-trunc", "-q", *services).split()
            if services
            else []
        )
        known = {node.ident: node for node in nodes()} if listed else {}
        facts = _inspected("task", listed)
        wanted = [_computer(fact, known) for fact in facts if fact["DesiredState"] == "running"]
        ended = [_computer(fact, known) for fact in facts if fact["DesiredState"] == "shutdown"]
        rejected = [one for one in ended if one.state == "rejected"]
        return sorted(wanted, key=lambda one: one.number), rejected

    def _services(self) -> list[str]:
        label = f"label=com.docker.stack.namespace={self.name}"
        return output("docker", "service", "ls", "--filter", label, "--format", "{{.Name}}").split()

    def down(self) -> None:
        """Removes the stack; returns once its containers and networks are removed.

        Does nothing if the swarm no longer exists.
        """
        if output("docker", "info", "-f", "{{.Swarm.LocalNodeState}}").strip() == "inactive":
            self.file.unlink(missing_ok=True)
            return
        output("docker", "stack", "rm", self.name)
        label = f"label=com.docker.stack.namespace={self.name}"
        kinds = (("ps", "-aq"), ("network", "ls", "-q"))

        def gone() -> bool:
            return not any(output("docker", *words, "--filter", label).strip() for words in kinds)

        if not awaited(gone, REMOVAL):
            what = f"the stack {self.name} has not ended"
            raise ContainerError(f"{what} after {REMOVAL:g} s: docker stack ps {self.name}")
        self.file.unlink(missing_ok=True)

    def logs(self, follow: bool, names: Sequence[str]) -> None:
        """Prints the logs of the named computers, by default of all; with ``follow``, until Ctrl-C.

        Raises:
            ContainerError: no such computer.
        """
        tasks = {one.name: one.task for one in self.computers()} if names else {}
        for name in names:
            if name not in tasks:
                raise ContainerError(
                    f"no computer {name} runs; there are {', '.join(tasks) or 'none'}"
                )
        sources = [tasks[name] for name in names] or self._services()
        words = ["docker", "service", "logs", *(["-f"] if follow else [])]
        running = [subprocess.Popen([*words, source]) for source in sources]
        for process in running:
            process.wait()


def _computer(fact: Mapping[str, Any], known: Mapping[str, Node]) -> Computer:
    spec, status = fact["Spec"]["ContainerSpec"], fact["Status"]
    node = known.get(fact.get("NodeID", ""))
    environment = dict(line.split("=", 1) for line in spec.get("Env", ()))
    # The base station's service has one task; robots' services also have their role.
    is_base = "ROS_MASTER_URI" in environment
    name = BASE if is_base else f"{ROBOTS}{fact['Slot']}"
    state = status["State"] if node is None or node.up else "unreachable"
    return Computer(
        name,
        status.get("ContainerStatus", {}).get("ContainerID", ""),
        state,
        "",
        environment,
        spec["Image"],
        node.name if node else "",
        node.docker if node else DOCKER,
        fact["ID"],
        status.get("Err", ""),
    )
