"""A swarm of several Docker engines on this machine, for tests and measurements without a real swarm.

The manager is this machine's engine. Each further host is a Docker engine in its own network, host name and PID
namespace, connected to a bridge by a virtual cable.
"""

import contextlib
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from containers.engine import ContainerError, output
from containers.registry import CONTAINER, PORT
from containers.swarm import awaited

BRIDGE, SUBNET = "pioneer-hosts", "10.88.11"
MANAGER = f"{SUBNET}.1"
"""This machine's address in the swarm."""
START = 60.0
"""Time-out for an engine's first answer, and for the swarm to see a node [s]."""
_ENGINE = (
    "hostname {name}; mount -t tmpfs none /run/docker; mount -t tmpfs none /run/containerd; "
    "dockerd --config-file {home}/daemon.json >{home}/log 2>&1 & wait"
)
"""The first process of the host's PID namespace is a shell: when it dies all others die, as on a loss of power."""


class Host:
    """A further host."""

    def __init__(self, number: int, folder: Path) -> None:
        #: name: host name, and name of the engine's Docker context
        #: link: its network cable
        self.name, self._home = f"node{number}", folder / f"node{number}"
        self.link, self._address = f"pioneer-node{number}", f"{SUBNET}.{10 + number}"
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Starts the engine with its previous data; returns once it answers.

        Raises:
            ContainerError: the engine does not answer.
        """
        self._home.mkdir(exist_ok=True)
        _remove_link(self.link)
        output("ip", "netns", "add", self.link)
        output(
            "ip",
            "link",
            "add",
            self.link,
            "type",
            "veth",
            "peer",
            "name",
            "eth0",
            "netns",
            self.link,
        )
        output("ip", "link", "set", self.link, "master", BRIDGE, "up")
        inside = ("ip", "-n", self.link)
        output(*inside, "addr", "add", f"{self._address}/24", "dev", "eth0")
        for link in ("eth0", "lo"):
            output(*inside, "link", "set", link, "up")
        output(*inside, "route", "add", "default", "via", MANAGER)
        socket = f"unix://{self._home}/socket"
        # A machine's /run is empty after a restart; a stale pidfile would name some other process.
        shutil.rmtree(self._home / "exec", ignore_errors=True)
        (self._home / "pid").unlink(missing_ok=True)
        parts = {"data-root": "data", "exec-root": "exec", "pidfile": "pid"}
        config = {
            **{key: str(self._home / name) for key, name in parts.items()},
            "hosts": [socket],
            "storage-driver": output("docker", "info", "-f", "{{.Driver}}").strip(),
            "insecure-registries": [f"{MANAGER}:{PORT}"],
        }
        (self._home / "daemon.json").write_text(json.dumps(config))
        apart = ["unshare", "--mount", "--uts", "--pid", "--fork", "--kill-child", "--mount-proc"]
        # Enters only its network namespace, so that it shares this machine's control groups.
        command = ["nsenter", f"--net=/run/netns/{self.link}", *apart, "bash", "-c"]
        script = _ENGINE.format(name=self.name, home=self._home)
        self._process = subprocess.Popen(
            [*command, script], stdin=subprocess.DEVNULL, start_new_session=True
        )
        if not awaited(lambda: _answers(socket), START):
            last = (self._home / "log").read_text().splitlines()[-1:]
            raise ContainerError(
                f"the engine of {self.name} does not answer after {START:g} s: {''.join(last)}"
            )
        contexts = output("docker", "context", "ls", "-q").split()
        if self.name not in contexts:
            output("docker", "context", "create", self.name, "--docker", f"host={socket}")

    def join(self) -> None:
        """Makes it a worker of the swarm unless it is one; returns once the swarm reports it as ready."""
        if _is_ready(self.name):
            return
        token = output("docker", "swarm", "join-token", "-q", "worker").strip()
        output(
            "docker", "--context", self.name, "swarm", "join", "--token", token, f"{MANAGER}:2377"
        )
        self.ready()

    def ready(self) -> None:
        """Waits until the swarm reports the host as ready.

        Raises:
            ContainerError: time-out.
        """
        if not awaited(lambda: _is_ready(self.name), START):
            raise ContainerError(f"{self.name} is not ready after {START:g} s: docker node ls")

    def kill(self) -> None:
        """Kills it with everything on it, like a loss of power."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


def _answers(socket: str) -> bool:
    return not subprocess.run(
        ["docker", "-H", socket, "version"], capture_output=True, check=False
    ).returncode


def _is_ready(name: str) -> bool:
    listed = output("docker", "node", "ls", "--format", "{{.Hostname}} {{.Status}}")
    return f"{name} Ready" in listed.splitlines()


def _remove_link(name: str) -> None:
    """Removes a host's network, and processes that an interrupted run may have left in it."""
    left = subprocess.run(
        ["ip", "netns", "pids", name], capture_output=True, text=True, check=False
    ).stdout.split()
    for pid in left:
        subprocess.run(["kill", "-KILL", pid], capture_output=True, check=False)
    for words in (("netns", "del", name), ("link", "del", name)):
        subprocess.run(["ip", *words], capture_output=True, check=False)


def is_in_swarm() -> bool:
    """Returns whether this machine's engine is in a swarm."""
    return output("docker", "info", "-f", "{{.Swarm.LocalNodeState}}").strip() != "inactive"


@contextlib.contextmanager
def swarm_here(count: int) -> Iterator[Sequence[Host]]:
    """Provides a swarm managed by this machine, with ``count`` further hosts that run but have not joined yet.

    On exit, the hosts, the swarm, the bridge and any registry started by ``./pioneer up`` are removed. Docker contexts
    are kept in a separate configuration.

    Raises:
        ContainerError: no permission, this engine is already in a swarm, or something does not start.
    """
    if os.geteuid() != 0:
        raise ContainerError("engines in network namespaces need root")
    if is_in_swarm():
        raise ContainerError(
            "this engine is in a swarm already, and in one only: docker swarm leave --force"
        )
    folder, before = (
        Path(tempfile.mkdtemp(prefix="pioneer-hosts-", dir="/var/tmp")),
        os.environ.get("DOCKER_CONFIG"),
    )
    hosts = [Host(number + 1, folder) for number in range(count)]
    os.environ["DOCKER_CONFIG"] = str(folder)
    try:
        _make_bridge()
        with ThreadPoolExecutor() as pool:
            list(pool.map(Host.start, hosts))
        output("docker", "swarm", "init", "--advertise-addr", MANAGER, "--listen-addr", MANAGER)
        yield hosts
    finally:
        _remove(hosts)
        shutil.rmtree(folder)
        del os.environ["DOCKER_CONFIG"]
        if before is not None:
            os.environ["DOCKER_CONFIG"] = before


_FORWARD = ("FORWARD", "-i", BRIDGE, "-o", BRIDGE, "-j", "ACCEPT")


def _make_bridge() -> None:
    subprocess.run(["ip", "link", "del", BRIDGE], capture_output=True, check=False)
    output("ip", "link", "add", BRIDGE, "type", "bridge")
    output("ip", "addr", "add", f"{MANAGER}/24", "dev", BRIDGE)
    output("ip", "link", "set", BRIDGE, "up")
    # Docker drops unknown traffic, including traffic across a bridge.
    output("iptables", "-w", "-I", *_FORWARD)


def _remove(hosts: Sequence[Host]) -> None:
    """Removes everything that exists of the hosts."""
    for host in hosts:
        host.kill()
        _remove_link(host.link)
    listing = [
        "docker",
        "images",
        "--filter",
        f"reference={MANAGER}:{PORT}/*",
        "--format",
        "{{.Repository}}:{{.Tag}}",
    ]
    images = subprocess.run(listing, capture_output=True, text=True, check=False).stdout.split()
    for command in (
        ["docker", "swarm", "leave", "--force"],
        ["docker", "rm", "-f", "-v", CONTAINER],
        ["docker", "volume", "rm", CONTAINER],
        ["docker", "rmi", *images],
        ["iptables", "-w", "-D", *_FORWARD],
        ["ip", "link", "del", BRIDGE],
    ):
        subprocess.run(command, capture_output=True, check=False)
