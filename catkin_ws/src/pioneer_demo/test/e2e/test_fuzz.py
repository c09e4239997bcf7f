"""Hostile input at every interface of a driving fleet: no process ends, no robot stops, no memory use grows.

`PIONEER_FUZZ_MINUTES` and `PIONEER_FUZZ_SEED` set duration and seed; `./pioneer test --fuzz` sets both.
"""

import json
import os
import statistics
import sys
import time
from collections import Counter
from pathlib import Path
from urllib.parse import urlsplit

import psutil
from std_srvs.srv import Trigger

from pioneer_fleet.registry import running_fleets
from pioneer_harness.proc import process_states
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until
from tcpros.client import Client

MB = 1_000_000
FUZZERS = Path(__file__).parent.parent / "fuzz"
START_UP = 120.0
LEG = 45.0
"""Time limit for a robot to reach its next waypoint, 4 m away [s of simulated time]; it takes 9 to 15 s."""
CLOCK_STANDS_STILL = 20.0
"""Longest time for which the simulated clock may stand still [s of wall time]."""
GROWTH, GROWTH_AT_FIRST = 12 * MB, 40 * MB
"""Allowed growth of a process since its first quarter; higher in a short run, in which caches are still filling."""
LONG = 10.0
"""From this duration on, a run counts as long [min]."""
REPORT = 30.0
PATROLS = {
    "pioneer1": [(2.4, -10.0), (-2.1, -7.3), (-2.1, -11.9)],
    "pioneer2": [(-2.7, 20.6), (1.6, 17.0), (-3.7, 15.2)],
}
"""Places in ``closed_maze`` near where the robots start, x and y [m]."""
# Debian's C++ nodes and the ROS master are not part of this project, and the fleet's command is not a node.
FOREIGN = ("rosout", "robot_state_publisher", "rosmaster", "roslaunch", "fleet_observer")


class Fleet:
    """Two robots on endless patrols, started by ``./pioneer fleet`` and observed from outside."""

    def __init__(self, running, folder: Path) -> None:
        self.running = running
        running.await_words("2 robots are ready", START_UP)
        self.first = self.status()
        self.masters = {robot["robot"]: robot["master"] for robot in self.first["robots"]}
        # The scripts that set up rules exit by themselves.
        self.processes = {
            pid: line for pid, line in running.processes().items() if "/rocon_flip/" not in line
        }
        self.memory = {pid: [] for pid in self.processes}
        self.reached = dict.fromkeys(self.masters, 0)
        self.left = dict.fromkeys(self.masters, self.first["simulated_seconds"])
        self.longest = dict.fromkeys(self.masters, 0.0)
        self.clock, self.clock_seen = 0.0, time.monotonic()
        for robot, places in PATROLS.items():
            self._patrol(robot, places, folder / f"{robot}.yaml")

    def status(self) -> dict:
        found = next(
            (one for one in running_fleets() if one["pid"] == self.running.process.pid), None
        )
        assert found, f"the fleet ends:\n{self.running.text()}"
        return found

    def _patrol(self, robot: str, places, path: Path) -> None:
        waypoints = ", ".join(f"{{x: {x}, y: {y}}}" for x, y in places)
        path.write_text(f"loop: true\nwaypoints: [{waypoints}]\n")
        client = f"/{robot}/map_goal_client"
        master = Client(self.masters[robot], "/fuzz")
        master.ask_master("setParam", f"{client}/patrol", str(path))
        answer = master.call(f"{client}/patrol", Trigger)
        assert answer.success, answer.message

    def addresses(self) -> list[str]:
        """Returns everything that accepts connections, in the format that ``wire.py`` takes."""
        hub = urlsplit(self.first["hub"]).netloc
        slaves = set().union(*map(_slave_apis, [self.first["master"], *self.masters.values()]))
        found = [f"hub={hub}", f"member={hub}", *(f"slave={one}" for one in sorted(slaves))]
        for pid, line in self.processes.items():
            kind = "relay" if "__name:=gateway" in line else "tcpros"
            if "__name:=" in line and not any(word in line for word in FOREIGN):
                others = {f"127.0.0.1:{port}" for port in _ports(pid)} - slaves
                found += [f"{kind}={one}" for one in sorted(others - {hub})]
        return found

    def look(self) -> None:
        """Fails if a process has ended or a robot makes no progress."""
        assert self.running.process.poll() is None, self.running.text()
        status, moment = self.status(), time.monotonic()
        if status["simulated_seconds"] > self.clock:
            self.clock, self.clock_seen = status["simulated_seconds"], moment
        assert moment - self.clock_seen < CLOCK_STANDS_STILL, (
            f"simulated time stands still at {self.clock} s"
        )
        for robot in status["robots"]:
            name = robot["robot"]
            leg = self.clock - self.left[name]
            self.longest[name] = max(leg, self.longest[name])
            assert leg < LEG, f"{name} has been on its way for {leg:.0f} s: {robot}"
            if robot["reached"] > self.reached[name]:
                self.reached[name], self.left[name] = robot["reached"], self.clock

    def sample(self) -> None:
        """Records the memory of every process."""
        states = process_states()
        gone = [
            line
            for pid, line in self.processes.items()
            if pid not in states or not states[pid].alive
        ]
        assert not gone, f"ended: {gone}"
        for pid, taken in self.memory.items():
            taken.append(states[pid].rss)


def _slave_apis(uri: str) -> set[str]:
    """Returns the XML-RPC server's host:port of each of this project's nodes on a master."""
    master = Client(uri, "/fuzz")
    nodes = {
        node for kind in master.ask_master("getSystemState") for _, found in kind for node in found
    }
    ours = [node for node in nodes if not any(word in node for word in FOREIGN)]
    addresses = [urlsplit(master.ask_master("lookupNode", node)) for node in ours]
    return {f"127.0.0.1:{address.port}" for address in addresses}


def _ports(pid: int) -> set[int]:
    """Returns the TCP ports that a process listens on."""
    connections = psutil.Process(pid).connections("tcp")
    return {one.laddr.port for one in connections if one.status == psutil.CONN_LISTEN}


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def start_fuzzers(group: ProcessGroup, fleet: Fleet, folder: Path, seed: int) -> list[Path]:
    """Starts one fuzzer per master and one for the ports; returns the files to which they write their counts."""
    logs = []

    def start(name: str, program: str, *words: str, **environment: str) -> None:
        logs.append(folder / f"{name}.log")
        argv = [sys.executable, str(FUZZERS / program), str(seed + len(logs)), *words]
        path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        group.start(name, argv, {**os.environ, **path, **environment}, logs[-1])

    robots = list(fleet.masters)
    for name, uri in {"base": fleet.first["master"], **fleet.masters}.items():
        rate, known = ("3", robots) if name == "base" else ("1", [name])
        start(name, "ros.py", rate, *known, ROS_MASTER_URI=uri, ROS_IP="127.0.0.1")
    start("ports", "wire.py", "60", *fleet.addresses())
    return logs


def counts(logs: list[Path]) -> Counter[str]:
    """Returns how often each target has been hit so far."""
    total = Counter[str]()
    for log in logs:
        lines = [
            line
            for line in (log.read_text().splitlines() if log.exists() else [])
            if line.startswith("{")
        ]
        total.update(json.loads(lines[-1]) if lines else {})
    return total


def test_a_fleet_keeps_reaching_waypoints_under_hostile_input(
    start, tmp_path, monkeypatch, record_property
):
    minutes = float(os.environ.get("PIONEER_FUZZ_MINUTES", "1"))
    seed = int(os.environ.get("PIONEER_FUZZ_SEED", "1"))
    monkeypatch.setenv("ROCON_HUB_PASSWORD", "fuzz")
    fleet = Fleet(start("--robots", 2, command="fleet"), tmp_path)
    say(f"the fleet drives; {minutes:g} minutes of hostile input, seed {seed}")
    with ProcessGroup() as group:
        logs = start_fuzzers(group, fleet, tmp_path, seed)
        watch(fleet, group, logs, 60 * minutes)
    met = counts(logs)
    before = dict(fleet.reached)
    wait_until(
        lambda: fleet.look() or all(fleet.reached[one] > before[one] for one in before),
        "one more waypoint",
        90,
    )
    verdict(fleet, met, GROWTH if minutes >= LONG else GROWTH_AT_FIRST, record_property)


def watch(fleet: Fleet, group: ProcessGroup, logs: list[Path], seconds: float) -> None:
    """Watches fleet and fuzzers for this long; fails, too, if a fuzzer is stuck waiting for an answer."""
    began = told = time.monotonic()
    end = began + seconds
    halfway: list[Counter[str]] = []

    def turn() -> bool:
        nonlocal told
        group.check()
        fleet.look()
        if not halfway and time.monotonic() - began >= seconds / 2:
            halfway.extend(counts([log]) for log in logs)
        if time.monotonic() - told > min(REPORT, seconds / 12):
            told = time.monotonic()
            fleet.sample()
            say(
                f"{told - began:.0f} s: {sum(counts(logs).values())} inputs, waypoints {fleet.reached}"
            )
        return time.monotonic() >= end

    wait_until(turn, "the end of the time", seconds + 60)
    stuck = [log.name for log, count in zip(logs, halfway, strict=True) if counts([log]) == count]
    assert not stuck, f"{stuck} got no answer in the second half of the time"


def verdict(fleet: Fleet, met: Counter[str], most: float, record_property) -> None:
    """Reports and checks the results."""
    for target, count in sorted(met.items()):
        record_property(target, count)
        say(f"{target}: {count} inputs")
    for robot, count in fleet.reached.items():
        record_property(f"waypoints of {robot}", count)
    seconds = fleet.clock - fleet.first["simulated_seconds"]
    longest = {robot: round(leg) for robot, leg in fleet.longest.items()}
    say(
        f"waypoints reached: {fleet.reached} in {seconds:.0f} s of simulated time; longest ways {longest} s of {LEG:g}"
    )
    grown = {}
    for pid, taken in fleet.memory.items():
        quarter = max(1, len(taken) // 4)
        early, late = (
            statistics.median(taken[quarter : 2 * quarter]),
            statistics.median(taken[-quarter:]),
        )
        grown[pid] = late - early
    worst = max(grown, key=grown.__getitem__)
    say(f"memory: largest growth {grown[worst] / MB:.1f} MB, of {fleet.processes[worst][-150:]}")
    for pid, growth in grown.items():
        assert growth <= most, (
            f"{fleet.processes[pid]} grew by {growth / MB:.1f} MB: {fleet.memory[pid]}"
        )
