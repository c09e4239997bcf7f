"""Five robots, each on its computer: that they drive, that nothing but links connects them, and what faults do."""

import re
import socket
import struct

import pytest

from containers.engine import output
from containers.harness import Fleet
from pioneer_harness.wait import wait_until

NEAR = {1: (-2.0, -8.0), 2: (-2.0, 16.0), 3: (5.0, 2.0), 4: (19.0, -11.0), 5: (2.5, -9.0), 6: (-2.0, 9.5)}
"""A place near each robot's start."""
START = {1: (-2.0, -10.0), 2: (-2.0, 18.0), 3: (5.0, 1.0), 4: (21.0, -11.0), 5: (2.5, -11.0)}
HUB, RELAY = 6380, 6381
CXX = ("/rosout", "robot_state_publisher")
"""Nodes in C++, whose XML-RPC server knows no loopback; their data port does."""


class Errands:
    """Waypoints sent and awaited, robot by robot: a waypoint client counts from its start."""

    def __init__(self, fleet: Fleet) -> None:
        self.fleet = fleet
        self.sent = dict.fromkeys(START, 0)
        self._near = dict.fromkeys(NEAR, False)

    def send(self, *numbers: int) -> None:
        """Sends each to the place near its start, or back."""
        for number in numbers:
            self._near[number] = not self._near[number]
            self.fleet.send(number, *(NEAR if self._near[number] else START)[number])
            self.sent[number] = self.sent.get(number, 0) + 1

    def arrive(self, *numbers: int) -> None:
        """Waits until they have reached all they were sent to."""
        for number, report in self.fleet.arrived(numbers, self.sent).items():
            assert not report["aborted"], f"robot {number}: {report}"

    def undisturbed(self, *numbers: int) -> None:
        """Sees them arrive, with all their rules in force and their odometry coming all the while."""
        for number, report in self.fleet.arrived(numbers, self.sent).items():
            assert report["active"] == report["rules"], f"robot {number}: {report}"
            assert report["odom_gap"] < 2.0, f"robot {number}: {report}"
            assert not report["aborted"], f"robot {number}: {report}"

    def comes_back(self, number: int) -> None:
        """Sends a robot whose computer has started again, and whose waypoint client with it."""
        self.fleet.report(f"aadi{number}", "--until", "ready")
        self.sent[number] = 0
        self.send(number)
        self.arrive(number)


@pytest.fixture(scope="module")
def errands(five: Fleet) -> Errands:
    said = five.pioneer("up", "--robots", "5", "--waypoints", "1")
    assert re.search(r"^5 robots drive after \d+ s", said, re.M), said
    return Errands(five)


def test_five_robots_drive_a_minute_after_up(errands: Errands) -> None:
    five = errands.fleet
    # Two cores have so much in a minute; on a busy machine a clock would tell about its other work.
    assert five.cpu_seconds() < 120.0
    rows = [line.split() for line in five.pioneer("status").splitlines()[1:]]
    assert [row[0] for row in rows] == ["aadiworkstation", *(f"aadi{number}" for number in START)]
    assert all("drives" in row for row in rows[1:]), rows
    for number in START:
        five.execute(f"aadi{number}", "rosservice", "call", f"/pioneer{number}/map_goal_client/clear")
        errands.sent[number] = 1


def listeners(five: Fleet, computer: str) -> set[int]:
    """Returns the TCP ports on which a computer listens to others."""
    lines = (line.split() for line in five.execute(computer, "cat", "/proc/net/tcp").splitlines()[1:])
    found = [words[1].split(":") for words in lines if words[3] == "0A"]
    addresses = ((socket.inet_ntoa(struct.pack("<I", int(address, 16))), int(port, 16)) for address, port in found)
    return {port for address, port in addresses if not address.startswith("127.")}


@pytest.mark.parametrize("computer", ["aadiworkstation", "aadi1"])
def test_other_computers_reach_the_hub_and_the_relay_only(errands: Errands, computer: str) -> None:
    five = errands.fleet
    nodes = five.execute(computer, "rosnode", "list", "-a").splitlines()
    uris = {name: uri for uri, name in (line.split() for line in nodes)}
    assert all(uri.startswith("http://127.0.0.1:") for uri in uris.values()), uris
    cxx = {int(uri.rstrip("/").rpartition(":")[2]) for name, uri in uris.items() if name.endswith(CXX)}
    wanted = {HUB, RELAY} if computer == "aadiworkstation" else {RELAY}
    assert listeners(five, computer) - cxx == wanted
    script = "import socket, sys; socket.create_connection((sys.argv[1], int(sys.argv[2])), 2)"
    five.execute("aadi2", "python3", "-c", script, computer, str(RELAY))
    for port in (11311, 11312):
        with pytest.raises(Exception, match="refused"):
            five.execute("aadi2", "python3", "-c", script, computer, str(port))


def test_a_stopped_computer_comes_back_and_its_robot_goes_on(errands: Errands) -> None:
    errands.send(1, 2, 3, 4, 5)
    errands.fleet.docker("stop", "aadi2")
    errands.undisturbed(1, 3, 4, 5)
    errands.fleet.docker("start", "aadi2")
    errands.comes_back(2)


def test_a_killed_computer_comes_back_and_its_robot_goes_on(errands: Errands) -> None:
    errands.send(1, 2, 3, 4, 5)
    errands.fleet.docker("kill", "aadi3")
    errands.undisturbed(1, 2, 4, 5)
    errands.fleet.docker("start", "aadi3")
    errands.comes_back(3)


def test_a_computer_whose_network_goes_and_comes_reaches_its_waypoint(errands: Errands) -> None:
    five = errands.fleet
    errands.send(1, 2, 3, 4, 5)
    five.network("disconnect", "aadi4", "-f")
    errands.undisturbed(1, 2, 3, 5)
    output("docker", "network", "connect", "--ip", "10.88.7.104", "pioneer-test_aadi.robots", five.container("aadi4"))
    errands.arrive(4)


def test_a_killed_hub_comes_back_by_itself(errands: Errands) -> None:
    errands.send(1, 2, 3, 4, 5)
    errands.fleet.execute("aadiworkstation", "pkill", "-KILL", "redis-server")
    errands.undisturbed(1, 2, 3, 4, 5)
    for number in START:
        errands.fleet.report(f"aadi{number}", "--until", "ready")


def test_a_base_station_that_starts_again_finds_its_robots(errands: Errands) -> None:
    five = errands.fleet
    errands.send(1, 2, 3, 4, 5)
    began = five.docker("inspect", "aadiworkstation", "-f", "{{.State.StartedAt}}")
    five.execute("aadiworkstation", "pkill", "-KILL", "-f", "pioneer_gazebo_server")
    template = "{{.State.StartedAt}} {{.State.Running}}"
    wait_until(
        lambda: (
            (now := five.docker("inspect", "aadiworkstation", "-f", template)).endswith("true\n")
            and began[:30] not in now
        ),
        "start of the base station by the engine",
        timeout=60.0,
    )
    five.report("aadiworkstation")
    errands.arrive(1, 2, 3, 4, 5)


def test_a_sixth_robot_joins(errands: Errands) -> None:
    five = errands.fleet
    errands.send(1, 2, 3, 4, 5)
    five.pioneer("up", "--robots", "6", "--waypoints", "0")
    errands.send(6)
    errands.undisturbed(1, 2, 3, 4, 5)
    errands.arrive(6)
