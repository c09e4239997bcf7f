"""The tutorial's table of terminals for one machine, typed verbatim except for ports and the hub's name."""

import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

ROOT = Path(__file__).resolve().parents[5]
TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text()
SOURCE = f"source {ROOT}/catkin_ws/devel/setup.bash"
START, DRIVE, COMMAND = 120.0, 60.0, 30.0
HUB_MASTER, GATEWAY_MASTER, *ROBOTS = 11311, 11312, 11313, 11314


def rows() -> dict[str, str]:
    """Returns the command line of each terminal in the table, by the terminal's name."""
    table = TUTORIAL[TUTORIAL.index("| terminal | `export` |") :].partition("\n\n")[0]
    cells = [
        [cell.strip().strip("`") for cell in line.strip("|").split("|")]
        for line in table.splitlines()[2:]
    ]
    return {
        name: "; ".join([f"export {given}"] * bool(given) + [command])
        for name, given, _, command in cells
    }


class Terminals:
    """The terminals of the table; those of another test may be open at the same time."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.group, self.ports = folder, ProcessGroup(), PortReservation()
        wanted = (HUB_MASTER, GATEWAY_MASTER, *ROBOTS)
        self.port = {port: self.ports.take(port + 10000) for port in wanted}
        hub, name = self.ports.take(16380), f"Pioneer Hub {os.getpid()}"
        self._only_ours = (
            f"gateway_hub_uri:=http://127.0.0.1:{hub} gateway_hub_whitelist:=\"['{name}']\""
        )
        self._our_hub = (
            f"hub_name:='{name}' hub_port:={hub} hub_master_port:={self.port[HUB_MASTER]} "
            f"gateway_master_port:={self.port[GATEWAY_MASTER]}"
        )

    def type(self, name: str, line: str) -> None:
        line = line.replace("run-pioneer-hub", f"run-pioneer-hub {self._our_hub}")
        line = line.replace("pioneer_gateway.launch", f"pioneer_gateway.launch {self._only_ours}")
        line = re.sub(
            r"localhost:(\d+)", lambda found: f"localhost:{self.port[int(found[1])]}", line
        )
        environment = {
            key: value
            for key, value in os.environ.items()
            if key not in ("DISPLAY", "ROS_MASTER_URI")
        }
        home = {"ROS_IP": "127.0.0.1", "ROS_HOME": str(self.folder / "home")}
        argv = ["bash", "-c", f"{SOURCE}; {line}"]
        self.group.start(
            name, argv, environment | home, self.log(name), may_end=name.endswith("RViz")
        )

    def log(self, name: str) -> Path:
        return self.folder / f"{name.replace(' ', '-')}.log"

    def await_line(self, name: str, text: str) -> None:
        def printed() -> bool:
            self.group.check()
            return text in self.log(name).read_text()

        wait_until(printed, f"'{text}' in the terminal {name}", START)


@pytest.fixture
def terminals(tmp_path: Path) -> Iterator[Terminals]:
    made = Terminals(tmp_path)
    yield made
    made.group.stop()
    made.ports.release()


def test_the_table_of_terminals_starts_a_fleet_of_two_that_takes_waypoints(
    terminals: Terminals,
) -> None:
    typed = rows()
    assert len(typed) == 7
    for name, line in typed.items():
        if name.endswith("RViz"):
            # If both launches of the base station start in the same second, each may start Hub_Gateway's master.
            terminals.await_line("base station, hub", "as 'Hub_Gateway'")
        terminals.type(name, line)
    terminals.await_line("base station, simulation", "topics are advertised and flipped")
    for number in (1, 2):
        terminals.await_line(f"robot {number}, gateway", f"as 'aadi{number}_gateway'")
        terminals.await_line(f"robot {number}, navigation", "move_base is running")
    terminals.await_line("base station, RViz", "no display here (DISPLAY is not set)")

    (goal,) = re.findall(r"^    (rostopic pub -1 /pioneer1/map_goal .*)$", TUTORIAL, re.M)
    master = f"export ROS_IP=127.0.0.1 ROS_MASTER_URI=http://localhost:{terminals.port[ROBOTS[0]]}"
    subprocess.run(
        ["bash", "-c", f"{SOURCE}; {master}; {goal}"],
        check=True,
        timeout=COMMAND,
        capture_output=True,
    )
    terminals.await_line("robot 1, navigation", "driving to waypoint 1 (1.00, 1.00, 90 deg)")
    look = [
        "bash",
        "-c",
        f"{SOURCE}; {master}; rostopic echo -n 1 /pioneer1/odom/twist/twist/linear/x",
    ]

    def speed() -> float:
        said = subprocess.run(
            look, text=True, timeout=COMMAND, check=True, capture_output=True
        ).stdout
        return float(said.splitlines()[0])

    wait_until(lambda: speed() > 0.2, "the robot under way", DRIVE)
