"""Hostile input at every interface of a driving fleet: no process ends, no robot stops, no memory use grows.

`PIONEER_FUZZ_MINUTES` and `PIONEER_FUZZ_SEED` set duration and seed; `./pioneer test --fuzz` sets both.
"""

import json
import os
import re
import statistics
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from urllib.parse import urlsplit

import psutil
from simple_navigation_goals.msg import WaypointQueue
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
STOP = 0.3
"""Maximum time from an operator's STOP to its answer, which follows the robot's zero command [s].

The time in which the page waits for a processor does not count, as other programs of the machine decide on it."""
VIEWER = "the-viewers-token-1"
STOPPED_ROBOT = "pioneer3"
"""The robot that the operator stops all the time; it has no waypoints, and the others drive on."""
PATROLS = {
    "pioneer1": [(2.4, -10.0), (-2.1, -7.3), (-2.1, -11.9)],
    "pioneer2": [(-2.7, 20.6), (1.6, 17.0), (-3.7, 15.2)],
}
"""Places in ``closed_maze`` near where the robots start, x and y [m]."""
# Debian's C++ nodes and the ROS master are not part of this project, and the fleet's command is not a node.
FOREIGN = ("rosout", "robot_state_publisher", "rosmaster", "roslaunch", "fleet_observer")


class Progress:
    """Number of waypoints that a robot's client reports as reached, read from that node alone.

    The fleet's own status mixes true reports with those that the fuzzers send on the same topic.
    """

    def __init__(self, master_uri: str, robot: str) -> None:
        self.reached = 0
        node = f"/{robot}/map_goal_client"
        client = Client(master_uri, "/fuzz_progress")
        self._connection = client.subscribe(node, f"{node}/queue")
        self._connection.be_patient()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with self._connection:
            while True:
                try:
                    message = WaypointQueue().deserialize(self._connection.read_frame())
                except OSError:
                    return
                self.reached = message.reached


class Fleet:
    """Two robots on endless patrols and one at rest, started by ``./pioneer fleet`` and observed from outside.

    With the right of way, a robot whose move_base is sent a goal by somebody else stays where it is until its own next
    goal. So under hostile input only robots without it have to reach their waypoints.
    """

    def __init__(self, running, folder: Path, right_of_way: bool) -> None:
        self.running = running
        self.right_of_way = right_of_way
        self._folder = folder
        running.await_words("3 robots are ready", START_UP)
        self.first = self.status()
        self.masters = {robot["robot"]: robot["master"] for robot in self.first["robots"]}
        # The scripts that set up rules exit by themselves.
        self.processes = {
            pid: line for pid, line in running.processes().items() if "/rocon_flip/" not in line
        }
        self.memory = {pid: [] for pid in self.processes}
        self.reached = dict.fromkeys(PATROLS, 0)
        self.left = dict.fromkeys(PATROLS, self.first["simulated_seconds"])
        self.longest = dict.fromkeys(PATROLS, 0.0)
        self.longest_stand = 0.0
        self.clock, self.clock_seen = 0.0, time.monotonic()
        self.start_patrols()
        self.progress = {robot: Progress(self.masters[robot], robot) for robot in PATROLS}
        self.page, self.token = re.search(r"(http\S+:\d+)/#(\S+)", running.text()).groups()
        self.page_pid = next(
            pid for pid, line in self.processes.items() if "pioneer_web/fleet_page" in line
        )

    def status(self) -> dict:
        found = next(
            (one for one in running_fleets() if one["pid"] == self.running.process.pid), None
        )
        assert found, f"the fleet ends:\n{self.running.text()}"
        return found

    def start_patrols(self) -> None:
        """Sends the robots on their patrols, from the first waypoint on."""
        for robot, places in PATROLS.items():
            self._patrol(robot, places, self._folder / f"{robot}.yaml")

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
        self.longest_stand = max(self.longest_stand, moment - self.clock_seen)
        assert moment - self.clock_seen < CLOCK_STANDS_STILL, (
            f"simulated time stands still at {self.clock} s"
        )
        for name, progress in self.progress.items():
            leg = self.clock - self.left[name]
            self.longest[name] = max(leg, self.longest[name])
            assert leg < LEG or self.right_of_way, (
                f"{name} has been on its way for {leg:.0f} s: {status}"
            )
            if progress.reached > self.reached[name]:
                self.reached[name], self.left[name] = progress.reached, self.clock

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
        path = {"PYTHONPATH": fleet.running.python_path}
        group.start(name, argv, {**os.environ, **path, **environment}, logs[-1])

    robots = list(fleet.masters)
    for name, uri in {"base": fleet.first["master"], **fleet.masters}.items():
        rate, known = ("3", robots) if name == "base" else ("1", [name])
        start(name, "ros.py", rate, *known, ROS_MASTER_URI=uri, ROS_IP="127.0.0.1")
    start("ports", "wire.py", "60", *fleet.addresses())
    start("page", "page.py", fleet.page, VIEWER)
    return logs


def start_operator(group: ProcessGroup, fleet: Fleet, folder: Path) -> Path:
    """Starts an operator who stops a robot all the time; returns the file to which the times are written."""
    log = folder / "operator.log"
    words = (fleet.page, fleet.token, STOPPED_ROBOT, str(fleet.page_pid))
    argv = [sys.executable, str(FUZZERS / "operator_stops.py"), *words]
    path = {"PYTHONPATH": fleet.running.python_path}
    group.start("operator", argv, {**os.environ, **path}, log)
    return log


def newest_figures(log: Path) -> dict:
    """Returns the figures that a process has told last; empty before the first ones."""
    lines = log.read_text().splitlines(keepends=True) if log.exists() else []
    figures = [line for line in lines if line.startswith("{") and line.endswith("\n")]
    return json.loads(figures[-1]) if figures else {}


def counts(logs: list[Path]) -> Counter[str]:
    """Returns how often each target has been hit so far."""
    total = Counter[str]()
    for log in logs:
        total.update(newest_figures(log))
    return total


def test_what_another_thread_logs_does_not_get_into_a_line_of_figures(tmp_path):
    """Two calls of write for one line let a warning in between, and the test of hostile input could not read it."""
    program = """
import sys, threading
from figures import tell

def log():
    for _ in range(20000):
        sys.stderr.write("a warning\\n")

threads = [threading.Thread(target=log) for _ in range(2)]
for thread in threads:
    thread.start()
while any(thread.is_alive() for thread in threads):
    tell({"inputs": 1})
"""
    log = tmp_path / "log"
    with log.open("wb") as file:
        subprocess.run(
            [sys.executable, "-u", "-c", program],
            env={**os.environ, "PYTHONPATH": str(FUZZERS)},
            stdout=file,
            stderr=subprocess.STDOUT,
            check=True,
        )
    lines = set(log.read_text().splitlines())
    assert lines == {"a warning", '{"inputs": 1}'}


def test_a_fleet_keeps_reaching_waypoints_under_hostile_input(
    start, tmp_path, monkeypatch, record_property
):
    minutes = float(os.environ.get("PIONEER_FUZZ_MINUTES", "1"))
    attack(start, tmp_path, monkeypatch, record_property, minutes, right_of_way=False)


def test_robots_with_right_of_way_drive_again_after_hostile_input(
    start, tmp_path, monkeypatch, record_property
):
    minutes = float(os.environ.get("PIONEER_FUZZ_MINUTES", "1"))
    attack(start, tmp_path, monkeypatch, record_property, minutes, right_of_way=True)


def attack(start, tmp_path, monkeypatch, record_property, minutes: float, right_of_way: bool):
    """Attacks a fleet for so long, and checks that nothing ends meanwhile, and that it drives afterwards.

    How soon a STOP comes is judged without right of way, whose nodes take the processors of a small machine, too.
    """
    seed = int(os.environ.get("PIONEER_FUZZ_SEED", "1"))
    monkeypatch.setenv("ROCON_HUB_PASSWORD", "fuzz")
    monkeypatch.setenv("PIONEER_WEB_VIEWER_TOKEN", VIEWER)
    traffic = "--traffic" if right_of_way else "--no-traffic"
    running = start("--robots", 3, "--web", traffic, command="fleet")
    fleet = Fleet(running, tmp_path, right_of_way)
    say(f"the fleet drives; {minutes:g} minutes of hostile input, seed {seed}")
    with ProcessGroup() as group:
        operator = start_operator(group, fleet, tmp_path)
        wait_until(
            lambda: group.check() or newest_figures(operator), "the operator's first STOP", 60
        )
        logs = start_fuzzers(group, fleet, tmp_path, seed)
        watch(fleet, group, logs, operator, 60 * minutes)
    met = counts(logs)
    if right_of_way:
        fleet.start_patrols()
    before = dict(fleet.reached)
    wait_until(
        lambda: fleet.look() or all(fleet.reached[one] > before[one] for one in before),
        "one more waypoint",
        90,
    )
    verdict(fleet, met, GROWTH if minutes >= LONG else GROWTH_AT_FIRST, record_property)
    figures = newest_figures(operator)
    say(json.dumps(figures))
    itself = figures["slowest itself"]["seconds"]
    record_property("slowest STOP [s]", figures["slowest"]["seconds"])
    record_property("slowest STOP, without waiting for a processor [s]", itself)
    assert itself <= STOP or right_of_way, figures
    assert figures["STOPs"] > 10 * minutes, figures


def watch(
    fleet: Fleet, group: ProcessGroup, logs: list[Path], operator: Path, seconds: float
) -> None:
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
            inputs = sum(counts(logs).values())
            say(f"{told - began:.0f} s: {inputs} inputs, waypoints {fleet.reached}")
            say(f"  {_stop_figures(newest_figures(operator))}; load {os.getloadavg()[0]:.1f}")
        return time.monotonic() >= end

    wait_until(turn, "the end of the time", seconds + 60)
    stuck = [log.name for log, count in zip(logs, halfway, strict=True) if counts([log]) == count]
    assert not stuck, f"{stuck} got no answer in the second half of the time"


def _stop_figures(figures: dict) -> str:
    return (
        f"{figures['STOPs']} STOPs: median {figures['median']} s, 99 % within {figures['99 %']} s, "
        f"slowest {figures['slowest']['seconds']} s, "
        f"without waiting for a processor {figures['slowest itself']['seconds']:.3f} s, "
        f"{figures['over 0.3 s']} over 0.3 s"
    )


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
    say(f"simulated time stood still for {fleet.longest_stand:.1f} s at most")
    say("growth of each process's memory, from the second quarter to the last:")
    for pid in sorted(grown, key=grown.__getitem__, reverse=True):
        size = fleet.memory[pid][-1] / MB
        say(f"  {grown[pid] / MB:6.1f} MB of {size:4.0f} MB: {fleet.processes[pid][-110:]}")
    for pid, growth in grown.items():
        assert growth <= most, (
            f"{fleet.processes[pid]} grew by {growth / MB:.1f} MB: {fleet.memory[pid]}"
        )
