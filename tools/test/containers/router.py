"""A router between two Docker networks for tests; it forwards some ports and drops everything else."""

import contextlib
import json
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from containers.engine import ContainerError, output


@dataclass(frozen=True)
class Network:
    """A Docker network: its name and the first three octets of its addresses."""

    name: str
    subnet: str

    @property
    def router(self) -> str:
        """The router's address in this network."""
        return f"{self.subnet}.250"


class Router:
    """A container in both networks. Routes and rules exist only in containers, so they disappear with them."""

    def __init__(
        self, container: str, networks: tuple[Network, Network], ports: Sequence[int]
    ) -> None:
        self._pid, self._networks = _pid(container), networks
        self._rules("-P", "FORWARD", "DROP")
        for direction in ("--dports", "--sports"):
            words = ("-p", "tcp", "-m", "multiport", direction, ",".join(map(str, ports)))
            self._rules("-A", "FORWARD", *words, "-j", "ACCEPT")
        self._rules("-A", "FORWARD", "-j", "DROP")

    def _rules(self, *words: str) -> str:
        return _inside(self._pid, "iptables", "-w", *words)

    def join(self, container: str, network: Network) -> None:
        """Adds a route to the other network to a container of ``network``."""
        (other,) = (one for one in self._networks if one != network)
        _inside(
            _pid(container), "ip", "route", "add", f"{other.subnet}.0/24", "via", network.router
        )

    def packets(self, target: str) -> int:
        """Returns how many packets the router has forwarded (ACCEPT) or dropped (DROP)."""
        lines = (line.split() for line in self._rules("-nvxL", "FORWARD").splitlines()[2:])
        return sum(int(words[0]) for words in lines if words[2] == target)


@contextlib.contextmanager
def router(
    name: str, image: str, networks: tuple[Network, Network], ports: Sequence[int]
) -> Iterator[Router]:
    """Yields a router and removes it at the end; first removes one left by an interrupted run."""
    remove = ["docker", "rm", "-f", name]
    subprocess.run(remove, capture_output=True, check=False)
    first, second = networks
    command = ["docker", "create", "--name", name, "--init", "--sysctl", "net.ipv4.ip_forward=1"]
    output(*command, "--network", first.name, "--ip", first.router, image, "sleep", "infinity")
    try:
        output("docker", "network", "connect", "--ip", second.router, second.name, name)
        output("docker", "start", name)
        yield Router(name, networks, ports)
    finally:
        subprocess.run(remove, capture_output=True, check=False)


def _pid(container: str) -> int:
    (fact,) = json.loads(output("docker", "inspect", container))
    if not fact["State"]["Running"]:
        raise ContainerError(f"{fact['Name']} does not run")
    return int(fact["State"]["Pid"])


def _inside(pid: int, *command: str) -> str:
    """Runs a host program in a container's network namespace."""
    return output("nsenter", "-t", str(pid), "-n", *command)
