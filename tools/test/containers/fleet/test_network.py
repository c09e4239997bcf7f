"""Five robots, each on its own computer: they drive, and only gateway links connect them."""

import socket
import struct
from urllib.parse import urlsplit

import pytest
from tested_fleet import PATIENCE, Fleet

from containers.engine import ContainerError
from pioneer_harness.wait import wait_until

HUB, RELAY = 6380, 6381
CXX = ("/rosout", "robot_state_publisher")
"""C++ nodes: their XML-RPC server cannot be bound to loopback, but their data port can."""


def test_five_robots_drive_a_minute_after_up(started: tuple[Fleet, float]) -> None:
    # Two cores provide 120 s of CPU in a minute; wall time would also measure the machine's other load.
    _, cpu = started
    assert cpu < 120.0


def test_status_has_a_row_for_each_computer_with_its_robots_state(driving: Fleet) -> None:
    rows: list[list[str]] = []

    def drive_or_have_arrived() -> bool:
        # A robot on its way may stand still for a moment, for example while it replans.
        rows[:] = [line.split() for line in driving.pioneer("status").splitlines()[1:]]
        return all("drives" in row or "1/1" in row for row in rows[1:])

    wait_until(drive_or_have_arrived, "every robot under way or there", PATIENCE)
    assert [row[0] for row in rows] == [
        "aadiworkstation",
        *(f"aadi{number}" for number in range(1, 6)),
    ]


def listeners(fleet: Fleet, computer: str) -> set[int]:
    """Returns the TCP ports on which a computer accepts connections from others."""
    lines = (
        line.split() for line in fleet.execute(computer, "cat", "/proc/net/tcp").splitlines()[1:]
    )
    found = [words[1].split(":") for words in lines if words[3] == "0A"]
    addresses = (
        (socket.inet_ntoa(struct.pack("<I", int(address, 16))), int(port, 16))
        for address, port in found
    )
    return {port for address, port in addresses if not address.startswith("127.")}


@pytest.mark.parametrize("computer", ["aadiworkstation", "aadi1"])
def test_other_computers_reach_the_hub_and_the_relay_only(driving: Fleet, computer: str) -> None:
    masters = [
        f"http://localhost:{port}"
        for port in ((11311, 11312) if computer == "aadiworkstation" else (11311,))
    ]
    lists = [
        driving.execute(computer, "env", f"ROS_MASTER_URI={uri}", "rosnode", "list", "-a")
        for uri in masters
    ]
    nodes = [line.split() for line in "\n".join(lists).splitlines() if line]
    assert nodes
    assert all(uri.startswith("http://127.0.0.1:") for uri, _ in nodes), nodes
    cxx = {urlsplit(uri).port for uri, name in nodes if name.endswith(CXX)}
    wanted = {HUB, RELAY} if computer == "aadiworkstation" else {RELAY}
    assert listeners(driving, computer) - cxx == wanted
    script = "import socket, sys; socket.create_connection((sys.argv[1], int(sys.argv[2])), 2)"
    driving.execute("aadi2", "python3", "-c", script, computer, str(RELAY))
    for port in (11311, 11312):
        with pytest.raises(ContainerError, match="refused"):
            driving.execute("aadi2", "python3", "-c", script, computer, str(port))


def test_a_robots_computer_needs_less_than_half_of_the_originals_gigabyte(driving: Fleet) -> None:
    for number in range(1, 6):
        used = driving.memory(f"aadi{number}")
        assert 100e6 < used < 500e6, f"aadi{number}: {used / 1e6:.0f} MB"


def test_up_on_a_fleet_that_has_arrived_is_done_and_sends_nobody(driving: Fleet) -> None:
    robots = range(1, 6)
    before = driving.arrived(robots, dict.fromkeys(robots, 1))
    assert "5 robots, which ran already and are sent nowhere, are ready" in driving.pioneer("up")
    after = driving.arrived(robots, dict.fromkeys(robots, 1))
    assert [after[one]["received"] for one in robots] == [before[one]["received"] for one in robots]
