"""Two hosts, each with its own compose project; a router connects their networks, open for two ports only."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from errand import Errands
from router import Network, Router, router
from tested_fleet import PATIENCE, Fleet, fleet

from containers.engine import ContainerError, Project, compose_command
from containers.image import ensure_image
from containers.state import secret

COMPOSE = Path(__file__).parents[3] / "docker" / "compose.yaml"
HUB, RELAY = 6380, 6381
BASE = Network("pioneer-base_aadi.robots", "10.88.9")
ROBOTS = Network("pioneer-robots_aadi.robots", "10.88.10")
CONNECT = "import socket, sys; socket.create_connection((sys.argv[1], int(sys.argv[2])), 3)"
pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="a router's rules need root")


def start(made: Fleet, *computers: str, **variables: str) -> None:
    files = {
        "PIONEER_HUB_PASSWORD_FILE": str(secret("hub-password")),
        "PIONEER_DESKTOP_TOKEN_FILE": str(secret("desktop-token")),
    }
    shared = {**files, "PIONEER_ROBOTS": "2", **variables}
    Project(made.project, tuple(compose_command()), COMPOSE, {**made.environment, **shared}).run(
        "up", "-d", *computers
    )


class Hosts:
    """A base station on one host, the computers of two robots on another, and the robots' errands."""

    def __init__(self, base: Fleet, robots: Fleet, way: Router, errands: Errands) -> None:
        self.base, self.robots, self.way, self.errands = base, robots, way, errands


@pytest.fixture(scope="module")
def hosts() -> Iterator[Hosts]:
    image = os.environ.get("PIONEER_IMAGE", "pioneer")
    if "PIONEER_IMAGE" not in os.environ:
        ensure_image(image)
    with contextlib.ExitStack() as stack:
        base = stack.enter_context(fleet("pioneer-base", BASE.subnet))
        robots = stack.enter_context(fleet("pioneer-robots", ROBOTS.subnet))
        start(base, "aadiworkstation")
        start(robots, "aadi1", "aadi2", PIONEER_HUB_URI=f"http://{BASE.subnet}.100:{HUB}")
        way = stack.enter_context(router("pioneer-router", image, (BASE, ROBOTS), (HUB, RELAY)))
        way.join(base.container("aadiworkstation"), BASE)
        for name in ("aadi1", "aadi2"):
            way.join(robots.container(name), ROBOTS)
        yield Hosts(base, robots, way, stack.enter_context(contextlib.closing(Errands(robots))))


def test_rviz_started_before_the_world_shows_robots_of_another_host(hosts: Hosts) -> None:
    """When RViz starts, the base station's master is the only running part of the fleet."""
    waiting = "until rosnode list >/dev/null 2>&1; do sleep 0.2; done"
    shot = f"exec rosrun pioneer_description rviz_snapshot --robots 2 -o /tmp/rviz.png --timeout {PATIENCE:g}"
    with hosts.base.meanwhile("aadiworkstation", "bash", "-c", f"{waiting}; {shot}") as seen:
        hosts.errands.send(1, 2, wall=True)
        assert "RViz shows all 13 displays" in seen()


def test_robots_of_another_host_arrive_over_two_ports(hosts: Hosts) -> None:
    for errand in hosts.errands.sent:
        errand.reached()
        report = errand.over()
        assert report["active"] == report["rules"] > 0, report
    assert hosts.way.packets("ACCEPT") > 1000


@pytest.mark.parametrize("port", [8000, 11311, 11312])
def test_every_other_port_of_the_other_host_is_dropped(hosts: Hosts, port: int) -> None:
    base = f"{BASE.subnet}.100"
    hosts.robots.execute("aadi1", "python3", "-c", CONNECT, base, str(RELAY))
    dropped = hosts.way.packets("DROP")
    with pytest.raises(ContainerError, match="timed out"):
        hosts.robots.execute("aadi1", "python3", "-c", CONNECT, base, str(port))
    assert hosts.way.packets("DROP") > dropped
