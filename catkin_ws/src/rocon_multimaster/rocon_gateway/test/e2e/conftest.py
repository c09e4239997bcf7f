"""Real masters, a real hub and real gateway processes, with a client for any of their services."""

import contextlib
import os
import re
import signal
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from gateway_msgs import msg, srv

from pioneer_harness.machine import FarMachine, MachineError
from pioneer_harness.masters import Master
from pioneer_harness.port import PortReservation
from pioneer_harness.proc import arguments, descendants, process_state
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until
from tcpros.client import Client, Connection

HERE = Path(__file__).parent
RELAY_TEST = HERE.parents[2] / "rocon_relay/test"
sys.path[:0] = [str(HERE), str(RELAY_TEST / "unit")]
PROBE = Path(__file__).with_name("probe.py")


class Site:
    """A master with a gateway and probes."""

    def __init__(
        self, name: str, fleet: "Fleet", master: Any = None, prefix: Sequence[str] = ()
    ) -> None:
        self.name = name
        self.master = master or Master()
        self._client = Client(self.master.uri, "/test")
        self._fleet = fleet
        self.log = fleet.folder / f"{name}.log"
        self.pid = 0
        self._prefix = prefix
        self._probes: dict[str, int] = {}

    def start(self, environment: Mapping[str, str] | None = None, **parameters: Any) -> "Site":
        """Starts the gateway; `environment` adds environment variables."""
        defaults = {
            "name": self.name,
            "disable_uuids": True,
            "firewall": False,
            "hub_uri": self._fleet.hub_uri,
        }
        self.master.set_param("/gateway", {**defaults, **parameters})
        argv = [*self._prefix, "rosrun", "rocon_gateway", "gateway"]
        environment = {**self.master.environment, **(environment or {})}
        before = self._starts()
        self.pid = self._fleet.group.start(self.name, argv, environment, self.log)
        # A killed gateway's services stay on the master, so check the log: this line follows the last registration.
        wait_until(lambda: self._starts() > before, f"{self.name}'s start", START)
        return self

    def _starts(self) -> int:
        """Returns how often a gateway at this site has logged that it is ready."""
        return len(self._relay_ports())

    def _relay_ports(self) -> list[str]:
        return re.findall(r"relay on port (\d+)", self.log.read_text()) if self.log.exists() else []

    def connected(self) -> "Site":
        wait_until(lambda: self.info().connected, f"{self.name} on the hub", START)
        return self

    def call(self, service: str, kind: type, **fields: Any) -> Any:
        """Calls one of the gateway's services over TCPROS."""
        return self._client.call(f"/gateway/{service}", kind, **fields)

    def flip(self, gateway: str, kind: str, name: str, node: str = "", cancel: bool = False) -> int:
        return self.remote("flip", gateway, kind, name, node, cancel).result

    def pull(self, gateway: str, kind: str, name: str, node: str = "", cancel: bool = False) -> int:
        return self.remote("pull", gateway, kind, name, node, cancel).result

    def remote(
        self, action: str, gateway: str, kind: str, name: str, node: str = "", cancel: bool = False
    ) -> Any:
        remotes = [msg.RemoteRule(gateway, msg.Rule(kind, name, node))]
        return self.call(action, srv.Remote, remotes=remotes, cancel=cancel)

    def advertise(self, *names: str, cancel: bool = False) -> Any:
        return self.call(
            "advertise",
            srv.Advertise,
            rules=[msg.Rule("publisher", name, "") for name in names],
            cancel=cancel,
        )

    def info(self) -> msg.GatewayInfo:
        """Returns the latched gateway_info."""
        return self.latched("/gateway/gateway_info", msg.GatewayInfo)

    def states(self) -> dict[str, str]:
        """Returns state and reason of each rule, by action and name; "" for a rule that is not published yet."""
        found: dict[str, str] = defaultdict(str)
        for status in self.latched("/gateway/rules", DiagnosticArray).status:
            values = {one.key: one.value for one in status.values}
            found[f"{values['action']} {values['name']}"] = status.message
        return found

    def latched(self, topic: str, kind: type) -> Any:
        """Returns the latched message of one of the gateway's topics."""
        return self._client.latched("/gateway", topic, kind)

    def subscription(self, node: str, topic: str) -> Connection:
        """Connects to a publisher on this site's master and reads only the header."""
        return self._client.subscribe(node, topic)

    def relay_port(self) -> int:
        """Returns the port of the gateway's relay, as logged by the gateway."""
        return int(self._relay_ports()[-1])

    def talk(self, topic: str, name: str = "talker") -> int:
        """Starts a node that publishes its name on `topic`; waits until the master lists it."""
        pid = self.probe("talk", name, topic)
        wait_until(
            lambda: f"/{name}" in self.master.system_state()[0].get(topic, []),
            f"{topic} of {name}",
            START,
        )
        return pid

    def hear(self, topic: str, name: str = "listener") -> "Ear":
        """Starts a node that subscribes to `topic`; waits until the master lists it."""
        log = self._fleet.folder / f"{self.name}-{name}.log"
        pid = self.probe("hear", name, topic, log=log)
        wait_until(
            lambda: f"/{name}" in self.master.system_state()[1].get(topic, []),
            f"{name} on {topic}",
            START,
        )
        return Ear(log, pid)

    def probe(self, what: str, name: str, *arguments: object, log: Path | None = None) -> int:
        """Starts a probe (see `probe.py`)."""
        argv = [*self._prefix, sys.executable, str(PROBE), what, name, *map(str, arguments)]
        log = log or self._fleet.folder / f"{self.name}-{name}.log"
        pid = self._fleet.group.start(
            f"{self.name} {name}", argv, self.master.environment, log, may_end=True
        )
        self._probes[name] = pid
        return pid

    def end_probes(self) -> None:
        """Ends all probes of this site."""
        _end(list(self._probes.values()))
        self._probes.clear()

    def end_probe(self, name: str) -> None:
        """Ends one probe of this site."""
        _end([self._probes.pop(name)])

    def stop(self) -> None:
        """Ends the gateway and all probes."""
        _end([self.pid])
        self.end_probes()

    def cancel_all(self) -> None:
        """Cancels all rules."""
        info = self.info()
        self.call("advertise_all", srv.AdvertiseAll, cancel=True)
        if info.flip_watchlist:
            assert (
                self.call("flip", srv.Remote, remotes=info.flip_watchlist, cancel=True).result == 0
            )
        if info.pull_watchlist:
            assert (
                self.call("pull", srv.Remote, remotes=info.pull_watchlist, cancel=True).result == 0
            )

    def publishers(self, topic: str) -> list[str]:
        """Returns the nodes that publish `topic` according to the master."""
        return sorted(self.master.system_state()[0].get(topic, []))


def _end(pids: list[int]) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGINT)
    wait_until(
        lambda: not any(lives(pid) for pid in pids), "the end of what was interrupted", START
    )


def lives(pid: int) -> bool:
    """Returns whether a process is still running."""
    state = process_state(pid)
    return state is not None and state.alive


class Ear:
    """The messages that a `hear` probe has received."""

    def __init__(self, log: Path, pid: int) -> None:
        self._log = log
        self.pid = pid

    def times(self, text: str = "") -> list[float]:
        """Returns the receive time of each message, monotonic [s]; with `text`, only of messages equal to it."""
        rows = [
            line.split(" ", 1) for line in self._log.read_text().splitlines() if line[:1].isdigit()
        ]
        return [float(row[0]) for row in rows if not text or row[1] == text]

    def first_after(self, moment: float, text: str = "", timeout: float = 10) -> float:
        """Waits for a message after `moment`; returns the delay [s]."""
        wait_until(
            lambda: any(t > moment for t in self.times(text)),
            f"a message {text} in {self._log.name}",
            timeout,
        )
        return min(t for t in self.times(text) if t > moment) - moment


class Fleet:
    """A hub and its sites, which are torn down together."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.group = ProcessGroup()
        self.ports = PortReservation()
        self.hub_port = self.ports.take(16380)
        self.hub_uri = f"http://127.0.0.1:{self.hub_port}"
        self.hub_master = Master()
        self.hub_pid = 0
        self.sites: list[Site] = []

    @property
    def hub_name(self) -> str:
        """A name that no other hub announces on this machine."""
        return f"Test Hub {self.hub_port}"

    def start_hub(
        self, environment: Mapping[str, str] | None = None, node: str = "hub", **parameters: Any
    ) -> int:
        defaults = {"name": self.hub_name, "port": self.hub_port, "zeroconf": False}
        self.hub_master.set_param(f"/{node}", {**defaults, **parameters})
        argv = ["rosrun", "rocon_hub", "hub", f"__name:={node}"]
        environment = {**self.hub_master.environment, **(environment or {})}
        pid = self.group.start(node, argv, environment, self.folder / f"{node}.log")
        self.hub_pid = pid if node == "hub" else self.hub_pid
        return pid

    def start_second_hub(self) -> tuple[int, str]:
        """Starts another hub; returns its PID and address."""
        port = self.ports.take(18380)
        return self.start_hub(
            node="second_hub", name=f"Second Hub {port}", port=port
        ), f"http://127.0.0.1:{port}"

    def site(self, name: str, master: Any = None, prefix: Sequence[str] = ()) -> Site:
        """Adds a site; `prefix` is a command that runs other commands on the site's machine."""
        self.sites.append(Site(name, self, master, prefix))
        return self.sites[-1]

    def family(self, pid: int) -> set[int]:
        """Returns a process and all its descendants."""
        return descendants(self.group.states(), [pid])

    def signal(self, pids: Iterable[int], number: signal.Signals) -> None:
        """Sends a signal to processes."""
        for pid in pids:
            os.kill(pid, number)

    def redis_pid(self) -> int:
        """Returns the PID of the first hub's Redis; 0 while it is not running."""
        found = [
            pid
            for pid in self.family(self.hub_pid)
            if "redis-server" in " ".join(arguments(pid)[:1])
        ]
        return found[0] if found else 0

    def close(self) -> None:
        self.group.stop()
        for site in self.sites:
            site.master.stop()
        self.hub_master.stop()
        self.ports.release()


@pytest.fixture
def fleet(tmp_path: Path) -> Iterator[Fleet]:
    yield from _fleet(tmp_path)


@pytest.fixture
def fleets() -> type[Fleet]:
    """Makes fleets, which the test itself closes."""
    return Fleet


@pytest.fixture(scope="module")
def shared_fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    """A fleet shared by all tests of a file."""
    yield from _fleet(tmp_path_factory.mktemp("fleet"))


def _fleet(folder: Path) -> Iterator[Fleet]:
    made = Fleet(folder)
    yield made
    made.close()
    for log in folder.glob("*.log"):
        assert "Traceback" not in log.read_text(), log.read_text()


@pytest.fixture(scope="module")
def machine() -> Iterator[FarMachine]:
    """Another machine on the network, shared by all tests of a file."""
    try:
        made = FarMachine()
    except MachineError as error:
        pytest.skip(f"the network between machines is not tested here: {error}")
    yield made
    made.close()


@pytest.fixture(scope="module")
def standing_fleet(shared_fleet: Fleet) -> Fleet:
    """A hub with two sites, `base` and `robot`, shared by all tests of a module."""
    shared_fleet.start_hub()
    for name in ("base", "robot"):
        shared_fleet.site(name).start()
    return shared_fleet


@pytest.fixture
def standing(standing_fleet: Fleet) -> Iterator[tuple[Site, Site]]:
    """The two shared sites without any rules; their probes are ended afterwards."""
    base, robot = standing_fleet.sites[:2]
    for site in (base, robot):
        site.connected()
        wait_until(lambda s=site: s.states() == {}, "no rules", 10)
    yield base, robot
    for site in standing_fleet.sites[2:]:
        site.stop()
        site.master.stop()
    del standing_fleet.sites[2:]
    for site in (base, robot):
        site.end_probes()
        site.cancel_all()


@pytest.fixture
def pair(fleet: Fleet) -> tuple[Site, Site]:
    """Two sites, `base` and `robot`, on one hub."""
    fleet.start_hub()
    base, robot = fleet.site("base"), fleet.site("robot")
    base.start()
    robot.start()
    return base.connected(), robot.connected()


@pytest.fixture
def report(record_property: Any) -> Any:
    """Records a measured time [s] in the test results and prints it (visible with `-s`)."""

    def note(what: str, seconds: float) -> None:
        record_property(what, round(seconds, 3))
        sys.stdout.write(f"{what}: {seconds:.3f} s\n")

    return note
