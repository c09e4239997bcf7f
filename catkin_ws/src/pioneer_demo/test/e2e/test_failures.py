"""Kills, and stops for 20 s, each process of a native fleet in turn; prints the tables of ``docs/failures.md``.

Takes half an hour: ``./pioneer test --soak`` runs it. ``PIONEER_FAILURES`` restricts it to processes whose name in the
tables matches this regular expression.
"""

import os
import re
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from pioneer_fleet.registry import running_fleets
from pioneer_harness.proc import arguments
from pioneer_harness.wait import WaitError, wait_until

pytestmark = pytest.mark.soak

START_UP = 240.0
SETTLED = 60.0
"""Time limit for a fleet to be as before after a death [s]; one whose process is not started again waits for it."""
STOPPED = 20.0
CONTINUED = 30.0
"""Time limit for a process that was stopped to answer again [s]."""
LEFT = 60.0
"""Time limit for the end of a fleet's processes, once its command has ended [s]."""
KINDS = (
    ("redis-server", "Redis"),
    ("^\\S*python3 fork_server .*run-multi-pioneer", "fork server of the simulator's launcher"),
    ("^\\S*python3 fork_server .*run-pioneer-nav", "fork server of the navigation's launcher"),
    ("^\\S*python3 fork_server .*roslaunch", "fork server of the gateway's launcher"),
    ("rosmaster --core", "ROS master"),
    ("rosout/rosout", "`rosout`"),
    ("rocon_hub/hub.py", "hub"),
    ("rocon_gateway/gateway.py", "gateway"),
    ("run-multi-pioneer", "simulator's launcher"),
    ("run-pioneer-nav", "navigation's launcher"),
    ("rocon_launch/roslaunch", "gateway's launcher"),
    ("pioneer_gazebo_server", "simulator"),
    ("nav_bundle/map_server", "`map_server`"),
    ("robot_state_publishers", "`robot_state_publishers`"),
    ("nav_bundle/amcl", "`amcl`"),
    ("nav_bundle/move_base", "`move_base`"),
    ("pioneer_node/node_host", "`light_nodes`"),
    ("pioneer_web/fleet_page", "fleet page"),
    ("recording.recorder", "recorder"),
)
"""Words in a command line, and what the process is."""
PROGRESS = re.compile(r"^\s*\d+\.\d s  starting|^\s*pioneer\d |^$")
"""Lines that only show the state."""


class Fleet:
    """A fleet of one robot with its page and a recorder, and its processes by computer and kind."""

    def __init__(self, start, folder: Path, number: int) -> None:
        record = folder / f"record{number}.mcap"
        options = ("--robots", 1, "--world", "small_world", "--web", "--record", record)
        self.running = start(*options, command="fleet")
        wait_until(self._is_ready, "the fleet's start", START_UP)
        ports = re.search(
            r"masters: hub (\d+), Hub_Gateway (\d+), robots (\d+)", self.running.text()
        ).groups()
        self._computers = dict(zip(ports, ("hub", "base station", "robot"), strict=True))
        wait_until(lambda: self.named("base station: fleet page"), "the page", START_UP)
        self.all = set(self.labels())

    def _is_ready(self) -> bool:
        assert not self.has_ended, f"it ended too early:\n{self.running.text()}"
        return "ready in" in self.running.text()

    @property
    def has_ended(self) -> bool:
        return self.running.process.poll() is not None

    def is_gone(self) -> bool:
        """Returns whether no process is left."""
        return not self.running.processes()

    def labels(self) -> dict[str, int]:
        """Returns the process ID of each process, by its name in the tables."""
        found = {}
        for pid, line in self.running.processes().items():
            kind = next((name for words, name in KINDS if re.search(words, line)), None)
            if kind is not None:
                found[f"{self._computer(pid)}: {kind}"] = pid
        return found

    def named(self, label: str) -> int | None:
        return self.labels().get(label)

    def _computer(self, pid: int) -> str:
        try:
            variables = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
        except OSError:
            variables = []
        found = [one for one in variables if one.startswith(b"ROS_MASTER_URI=")]
        port = found[-1].decode().rstrip("/").rpartition(":")[2] if found else ""
        port = next((word for word in arguments(pid) if word in self._computers), port)
        return self._computers.get(port, "base station")

    @property
    def faults(self) -> list[str]:
        """Its faults as ``./pioneer status`` shows them."""
        pid = self.running.process.pid
        return next((one["faults"] for one in running_fleets() if one["pid"] == pid), [])

    def is_restored(self, label: str, old: int) -> bool:
        """Returns whether a killed process was started again and all is as before, or the fleet has ended."""
        if self.has_ended:
            return True
        now = self.labels()
        return now.get(label) not in (None, old) and self.all <= set(now) and not self.faults

    def has_continued(self, was_named: bool, position: int) -> bool:
        """Returns whether there is no fault any more, or the fleet has ended."""
        is_answered = not was_named or bool(self.said_since(position))
        return self.has_ended or (not self.faults and is_answered)

    def said_since(self, position: int) -> list[str]:
        lines = self.running.output.read_bytes()[position:].decode(errors="replace").splitlines()
        return list(dict.fromkeys(line for line in lines if not PROGRESS.match(line)))

    @property
    def position(self) -> int:
        return self.running.output.stat().st_size


def chosen(fleet: Fleet) -> list[str]:
    """Returns the names of the processes to try."""
    words = os.environ.get("PIONEER_FAILURES", "")
    return [label for label in sorted(fleet.all) if re.search(words, label)]


def settles(condition: Callable[[], bool], timeout: float) -> bool:
    """Waits until a condition holds; returns whether it did in time."""
    try:
        return bool(wait_until(condition, "the fleet's recovery", timeout))
    except WaitError:
        return False


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def row(*cells: str) -> str:
    text = " | ".join(cell.replace("|", "/").replace("\n", " ") for cell in cells)
    return f"| {re.sub(r'pid [0-9]+', 'pid N', text)} |"


def short(lines: list[str], most: int = 3) -> str:
    """Returns the first lines as one cell, without the folders of this run."""
    return "<br>".join(f"`{line[:220]}`" for line in lines[:most]) or "nothing"


def test_the_death_of_each_process_is_said_and_mended_or_ends_the_fleet(start, tmp_path):
    fleet = Fleet(start, tmp_path, 0)
    todo = chosen(fleet)
    silent = []
    say(
        "\n| process | what is said | after [s] | what is started again | what ends |\n|---|---|---|---|---|"
    )
    for number, label in enumerate(todo, 1):
        before, position = fleet.labels(), fleet.position
        os.kill(before[label], signal.SIGKILL)
        began = time.monotonic()
        settles(partial(fleet.is_restored, label, before[label]), SETTLED)
        after = time.monotonic() - began
        if fleet.has_ended:
            began = time.monotonic()
            wait_until(fleet.is_gone, "the end of all its processes", LEFT)
        now = fleet.labels()
        said = fleet.said_since(position)
        again = [name for name, pid in sorted(now.items()) if before.get(name) != pid]
        gone = "the fleet" if fleet.has_ended else ", ".join(sorted(set(before) - set(now)))
        say(row(label, short(said), f"{after:.0f}", ", ".join(again) or "-", gone or "nothing"))
        if not said and not (again or "Redis" in label):
            silent.append(label)
        # A computer that is started three times in a minute keeps dying: the next trial gets a fresh fleet.
        if fleet.has_ended or set(now) != fleet.all or len(again) > 1:
            fleet.running.end()
            if number < len(todo):
                fleet = Fleet(start, tmp_path, number)
    assert not silent, f"nothing is said of the death of {silent}"


def test_a_process_that_hangs_is_named_and_continues(start, tmp_path):
    fleet = Fleet(start, tmp_path, 0)
    todo = chosen(fleet)
    say(
        "\n| process | what is said | after [s] | once it continues | what ends |\n|---|---|---|---|---|"
    )
    for number, label in enumerate(todo, 1):
        before, position = fleet.labels(), fleet.position
        os.kill(before[label], signal.SIGSTOP)
        began = time.monotonic()
        first = None
        while time.monotonic() - began < STOPPED and not fleet.has_ended:
            if first is None and fleet.said_since(position):
                first = time.monotonic() - began
            time.sleep(0.1)
        said = fleet.said_since(position)
        continued = fleet.position
        if fleet.named(label) == before[label]:
            os.kill(before[label], signal.SIGCONT)
        settles(partial(fleet.has_continued, bool(said), continued), CONTINUED)
        now = fleet.labels()
        gone = "the fleet" if fleet.has_ended else ", ".join(sorted(set(before) - set(now)))
        when = "-" if first is None else f"{first:.1f}"
        answered = short(fleet.said_since(continued))
        say(row(label, short(said), when, answered, gone or "nothing"))
        if fleet.has_ended or set(now) != fleet.all:
            fleet.running.end()
            if number < len(todo):
                fleet = Fleet(start, tmp_path, number)
