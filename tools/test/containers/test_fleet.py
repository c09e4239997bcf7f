"""Five robots, each on its computer: that they drive, and that nothing but links connects them."""

import re
import socket
import struct
from urllib.parse import urlsplit

import pytest

from containers.engine import ContainerError
from containers.harness import Fleet

HUB, RELAY = 6380, 6381
CXX = ("/rosout", "robot_state_publisher")
"""Nodes in C++, whose XML-RPC server knows no loopback; their data port does."""


@pytest.fixture(scope="module")
def driving(five: Fleet) -> Fleet:
    said = five.pioneer("up", "--robots", "5", "--waypoints", "1")
    assert re.search(r"^5 robots drive after \d+ s", said, re.M), said
    return five


def test_five_robots_drive_a_minute_after_up(driving: Fleet) -> None:
    # Two cores have so much in a minute; on a busy machine a clock would tell about its other work.
    assert driving.cpu_seconds() < 120.0
    rows = [line.split() for line in driving.pioneer("status").splitlines()[1:]]
    assert [row[0] for row in rows] == ["aadiworkstation", *(f"aadi{number}" for number in range(1, 6))]
    assert all("drives" in row or "1/1" in row for row in rows[1:]), rows


def listeners(fleet: Fleet, computer: str) -> set[int]:
    """Returns the TCP ports on which a computer listens to others."""
    lines = (line.split() for line in fleet.execute(computer, "cat", "/proc/net/tcp").splitlines()[1:])
    found = [words[1].split(":") for words in lines if words[3] == "0A"]
    addresses = ((socket.inet_ntoa(struct.pack("<I", int(address, 16))), int(port, 16)) for address, port in found)
    return {port for address, port in addresses if not address.startswith("127.")}


@pytest.mark.parametrize("computer", ["aadiworkstation", "aadi1"])
def test_other_computers_reach_the_hub_and_the_relay_only(driving: Fleet, computer: str) -> None:
    masters = [f"http://localhost:{port}" for port in ((11311, 11312) if computer == "aadiworkstation" else (11311,))]
    lists = [driving.execute(computer, "env", f"ROS_MASTER_URI={uri}", "rosnode", "list", "-a") for uri in masters]
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
