"""Base station and robots on two networks that only a router joins, which lets two ports through and drops the rest."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from containers.__main__ import hub_password
from containers.engine import ContainerError, Project, compose_command, output
from containers.harness import Fleet, fleet

COMPOSE = Path(__file__).parents[3] / "docker" / "compose.yaml"
BASE, ROBOTS = "10.88.9", "10.88.10"
WAYS = [(one, other, option) for one, other in ((BASE, ROBOTS), (ROBOTS, BASE)) for option in ("--dports", "--sports")]
RULES = [
    ["DOCKER-USER", "-s", f"{one}.0/24", "-d", f"{other}.0/24", "-p", "tcp", "-m", "multiport", option, "6380,6381"]
    for one, other, option in WAYS
]
"""Docker lets nothing pass between two networks of its own, but for what this chain accepts before."""


@pytest.fixture
def router() -> Iterator[None]:
    """This machine as the router, with the two ports open."""
    if os.geteuid():
        pytest.skip("opening ports between two networks of Docker's needs root")
    for rule in RULES:
        output("iptables", "-w", "-I", *rule, "-j", "ACCEPT")
    yield
    for rule in RULES:
        subprocess.run(["iptables", "-w", "-D", *rule, "-j", "ACCEPT"], check=True)


def start(made: Fleet, *computers: str, **variables: str) -> None:
    shared = {"PIONEER_HUB_PASSWORD_FILE": str(hub_password()), "PIONEER_ROBOTS": "2", **variables}
    Project(made.project, tuple(compose_command()), COMPOSE, {**made.environment, **shared}).run("up", "-d", *computers)


def test_two_ports_are_enough_between_hosts(router: None) -> None:
    with fleet("pioneer-base", BASE) as base, fleet("pioneer-robots", ROBOTS) as robots:
        start(base, "aadiworkstation")
        start(robots, "aadi1", "aadi2", PIONEER_HUB_URI=f"http://{BASE}.100:6380")
        for number in (1, 2):
            robots.report(f"aadi{number}", "--until", "moving", "--waypoints", "1", "--robots", "2")
        base.report("aadiworkstation")
        script = "import socket, sys; socket.create_connection((sys.argv[1], int(sys.argv[2])), 2)"
        robots.execute("aadi1", "python3", "-c", script, f"{BASE}.100", "6381")
        base.execute("aadiworkstation", "bash", "-c", "exec python3 -m http.server 8000 >/dev/null 2>&1 &")
        with pytest.raises(ContainerError, match="timed out"):
            robots.execute("aadi1", "python3", "-c", script, f"{BASE}.100", "8000")
