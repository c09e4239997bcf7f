"""A hub and two gateways, each on its own master, with publishers, subscribers and servers."""

import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from gateway_msgs import msg, srv
from roslib.packages import find_node

from pioneer_harness.masters import Master
from pioneer_harness.port import PortReservation, is_free
from pioneer_harness.proc import ProcessState, descendants, process_state, process_states
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until
from tcpros.client import Client, ClientError, Connection

PATIENCE = 20.0
"""Time-out for anything to start or arrive [s]."""

PREFERRED_PORT = 16380
_SCHEDULED = 2
"""CPUCLOCK_SCHED of Linux: a clock of the time that the scheduler has given, not of ticks."""


@dataclass(frozen=True)
class Process:
    """A started process."""

    pid: int
    log: Path = Path()  #: of its output

    @property
    def lives(self) -> bool:
        """Whether the process is still running."""
        state = process_state(self.pid)
        return state is not None and state.alive

    def end(self) -> None:
        """Sends SIGINT and waits until the process has ended."""
        if self.lives:
            os.kill(self.pid, signal.SIGINT)
            wait_until(lambda: not self.lives, f"the end of process {self.pid}", PATIENCE)

    def kill(self) -> None:
        """Sends SIGKILL and waits until the process has ended."""
        os.kill(self.pid, signal.SIGKILL)
        wait_until(lambda: not self.lives, "the end of what was killed", PATIENCE)

    def lines(self) -> list[str]:
        """Returns the complete lines that it has printed."""
        return self.log.read_text().split("\n")[:-1]

    def times(self) -> list[float]:
        """Returns the monotonic time stamps that it has printed [s]."""
        return [float(line) for line in self.lines() if line[:1].isdigit()]

    def first_after(self, moment: float) -> float:
        """Waits until it prints a time stamp after `moment`; returns the difference [s]."""
        wait_until(lambda: self.times()[-1:] > [moment], f"a message in {self.log.name}", PATIENCE)
        return next(time for time in self.times() if time > moment) - moment


class Site:
    """A master and its gateway."""

    def __init__(self, name: str, fleet: "Fleet") -> None:
        self.name = name
        self.master = Master()
        self.gateway = Process(0)
        self._fleet = fleet
        self._client = Client(self.master.uri, "/bench")

    def start(self) -> None:
        """Starts the gateway and waits until it is connected to the hub."""
        config = {
            "name": self.name,
            "disable_uuids": True,
            "firewall": False,
            "hub_uri": self._fleet.hub_uri,
        }
        self.master.set_param("/gateway", config)
        self.gateway = self.run("gateway", [find_program("rocon_gateway", "gateway")])
        # Waits for the service that the gateway advertises last.
        wait_until(
            lambda: self.serves("/gateway/set_watcher_period"), f"{self.name}'s services", PATIENCE
        )
        wait_until(self.is_connected, f"{self.name} on the hub", PATIENCE)

    def run(self, name: str, argv: list[str]) -> Process:
        """Starts a process on this master."""
        return self._fleet.run(f"{self.name}-{name}", argv, self.master)

    @contextmanager
    def running(self, name: str, *arguments: object) -> Iterator[Process]:
        """Starts one of this package's nodes; ends it on exit of the context."""
        process = self.run(name, module_argv(name, *arguments))
        try:
            yield process
        finally:
            process.end()

    def publishers(self, topic: str) -> list[str]:
        """Returns the publishers of a topic, according to the master."""
        return self.master.system_state()[0].get(topic, [])

    def serves(self, service: str) -> bool:
        """Returns whether the master knows a service."""
        return service in self.master.system_state()[2]

    def is_connected(self) -> bool:
        """Returns whether the gateway is connected to a hub; False if it does not answer."""
        try:
            info = self._client.latched("/gateway", "/gateway/gateway_info", msg.GatewayInfo)
        except (ClientError, OSError):  # a killed gateway stays registered at the master
            return False
        return bool(info.connected)

    def states(self) -> list[str]:
        """Returns the state and reason of each rule."""
        found = self._client.latched("/gateway", "/gateway/rules", DiagnosticArray)
        return [status.message for status in found.status]

    def advertise(self, topic: str) -> None:
        """Advertises a topic, so that other gateways can pull it."""
        rules = [msg.Rule("publisher", topic, "")]
        _check(self._client.call("/gateway/advertise", srv.Advertise, rules=rules))

    def service(self, name: str, kind: Any, persistent: bool) -> Connection:
        """Returns a connection to a service of this master."""
        return self._client.service(
            name, kind._md5sum, **({"persistent": "1"} if persistent else {})
        )

    def ask(self, action: str, gateway: str, kind: str, topic: str, cancel: bool = False) -> None:
        """Calls the gateway's `flip` or `pull`."""
        remotes = [msg.RemoteRule(gateway, msg.Rule(kind, topic, ""))]
        _check(self._client.call(f"/gateway/{action}", srv.Remote, remotes=remotes, cancel=cancel))


class Fleet:
    """The hub and two sites, `base` and `robot`.

    Args:
        folder: for the logs; each fleet has a folder of its own in it.
        variables: environment variables that all its processes get in addition to this one's.
    """

    def __init__(self, folder: Path, **variables: str) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="fleet-", dir=folder))
        self._variables = variables
        self._group = ProcessGroup()
        self._ports = PortReservation()
        self.port = self._ports.take(PREFERRED_PORT)  #: the hub's port
        self._number = count()
        self._hub_master = Master()
        self.hub_uri = f"http://127.0.0.1:{self.port}"
        self.hub = Process(0)
        self.base, self.robot = Site("base", self), Site("robot", self)

    def start(self) -> None:
        """Starts the hub and both sites."""
        self.start_hub()
        for site in (self.base, self.robot):
            site.start()

    @contextmanager
    def open_hub(self) -> Iterator[None]:
        """Restarts the hub so that other machines can reach it; restarts it closed on exit of the context."""
        for insecure in (True, False):
            self.hub.end()
            self.start_hub(insecure)
            for site in (self.base, self.robot):
                wait_until(site.is_connected, f"{site.name} on the hub", PATIENCE)
            if insecure:
                yield

    def start_hub(self, insecure: bool = False) -> None:
        """Starts the hub and waits until its port answers."""
        config = {"name": "Bench Hub", "port": self.port, "zeroconf": False, "insecure": insecure}
        self._hub_master.set_param("/hub", config)
        self.hub = self.run("hub", [find_program("rocon_hub", "hub")], self._hub_master)
        wait_until(lambda: not is_free(self.port), "the hub's port", PATIENCE)

    def run(self, name: str, argv: list[str], master: Master) -> Process:
        """Starts a process with its own log."""
        log = self._folder / f"{next(self._number)}-{name}.log"
        environment = {**master.environment, **self._variables}
        return Process(self._group.start(name, argv, environment, log, may_end=True), log)

    def close(self) -> None:
        """Ends all processes and masters."""
        self._group.stop()
        for master in (self.base.master, self.robot.master, self._hub_master):
            master.stop()
        self._ports.release()


def find_program(package: str, name: str) -> str:
    """Returns a program's path, found as roslaunch does: rosrun needs ten processes and 0.1 s for it."""
    (path,) = find_node(package, name)
    return str(path)


def module_argv(name: str, *arguments: object) -> list[str]:
    """Returns the command that runs one of this package's nodes."""
    return [sys.executable, "-m", f"pioneer_bench.nodes.{name}", *map(str, arguments)]


def family(pid: int) -> list[ProcessState]:
    """Returns the states of a process and all its descendants."""
    states = process_states()
    return [states[one] for one in sorted(descendants(states, [pid]))]


def cpu(pids: list[int]) -> float:
    """Returns the CPU time of processes [s], including that of threads that have ended, in nanoseconds' resolution.

    Raises:
        OSError: a process has ended.
    """
    return sum(time.clock_gettime(_cpu_clock(pid)) for pid in pids)


def _cpu_clock(pid: int) -> int:
    """Returns the id of a process's CPU-time clock, as clock_getcpuclockid(3) of Linux makes it."""
    return ~pid << 3 | _SCHEDULED


def _check(response: Any) -> None:
    if response.result:
        raise OSError(f"refused, {response.result}: {response.error_message}")
