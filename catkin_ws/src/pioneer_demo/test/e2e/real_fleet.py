"""A native fleet and its processes, for tests that disturb each of them."""

import re
from pathlib import Path
from typing import Any

from pioneer_fleet.registry import running_fleets
from pioneer_harness.proc import arguments
from pioneer_harness.wait import wait_until

START_UP = 240.0
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
    """A fleet with its page and a recorder, and its processes by computer and kind.

    Args:
        start: the fixture of that name.
        folder: for the recording.
        number: different for each fleet of a test.
        robots: number of robots.
        how: further arguments of the fixture.
    """

    def __init__(self, start, folder: Path, number: int, robots: int = 1, **how: Any) -> None:
        record = folder / f"record{number}.mcap"
        options = ("--robots", robots, "--world", "small_world", "--web", "--record", record)
        self.running = start(*options, command="fleet", **how)
        wait_until(self._is_ready, "the fleet's start", START_UP)
        ports = re.findall(
            r"masters: hub (\d+), Hub_Gateway (\d+), robots ([\d, ]+)", self.running.text()
        )
        hub, gateway, others = ports[0]
        names = [f"robot {number}" for number in range(1, robots + 1)] if robots > 1 else ["robot"]
        self._computers = {hub: "hub", gateway: "base station"}
        self._computers.update(zip(others.split(", "), names, strict=True))
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

    def masters(self, kind: str) -> list[str]:
        """Returns the ports of the masters of such computers."""
        return [port for port, name in self._computers.items() if name.startswith(kind)]

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
