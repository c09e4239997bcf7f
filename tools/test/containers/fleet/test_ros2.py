"""The door to ROS 2 of the running fleet: a node of rclpy on this machine reads five robots and sends one to a goal."""

import json
import math
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from errand import ROUNDS
from tested_fleet import PATIENCE, Fleet

from containers.engine import ROS2, output
from containers.harness import ROOT
from pioneer_harness.wait import wait_until

PEER = ROOT / ".setup" / "ros2-peer" / "bin" / "python3"
DRIVER = ROOT / "catkin_ws" / "src" / "pioneer_demo" / "test" / "e2e" / "ros2_driver.py"
DOMAIN = str(80 + os.getpid() % 20)
"""A domain that other runs on this machine hardly use."""
PLACES = {f"pioneer{number}": ROUNDS[number][0] for number in range(1, 6)}
BEAMS = 180
ARRIVED = 0.5
"""Largest distance of an arrived robot from its goal [m]."""

pytestmark = pytest.mark.skipif(
    not PEER.exists(), reason="no ROS 2 for the tests (PyPI has it for Python 3.11)"
)


@pytest.fixture(scope="module")
def door(driving: Fleet) -> Iterator[Fleet]:
    """Yields the fleet with the door to ROS 2; removes the door's container at the end."""
    driving.environment["ROS_DOMAIN_ID"] = DOMAIN
    said = driving.pioneer("up", "--ros2")
    assert f"Door to ROS 2: domain {DOMAIN}, for nodes on this machine and in 10.88.7.0/24" in said
    yield driving
    labels = (f"project={driving.project}", f"service={ROS2}")
    filters = [
        word for label in labels for word in ("--filter", f"label=com.docker.compose.{label}")
    ]
    output("docker", "rm", "-f", output("docker", "ps", "-aq", *filters).strip())


class Peer:
    """The node of rclpy: sends each robot to a place and prints where the robots are."""

    def __init__(self, log: Path) -> None:
        words = [str(word) for name, place in PLACES.items() for word in (name, *place)]
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        self._log = log
        self._output = log.open("wb")
        self._process = subprocess.Popen(
            [str(PEER), str(DRIVER), *words],
            env={**environment, "ROS_DOMAIN_ID": DOMAIN},
            stdout=self._output,
            stderr=self._output,
        )

    def newest(self, robot: str) -> dict[str, Any]:
        """Returns the newest line about a robot; empty before the first."""
        assert self._process.poll() is None, self._log.read_text()
        whole = self._log.read_text().rpartition("\n")[0]
        lines = [json.loads(line) for line in whole.splitlines() if line.startswith("{")]
        return next((line for line in reversed(lines) if line["robot"] == robot), {})

    def end(self) -> None:
        self._process.kill()
        self._process.wait()
        self._output.close()


def test_a_node_of_ros_2_on_this_machine_sees_five_robots_and_sends_them_to_places(
    door: Fleet, tmp_path: Path
) -> None:
    peer = Peer(tmp_path / "peer.log")

    def is_seen(robot: str) -> bool:
        line = peer.newest(robot)
        return bool(
            line.get("clock") and line["beams"] == BEAMS and line["true"] and line["believed"]
        )

    def is_there(robot: str) -> bool:
        line = peer.newest(robot)
        return bool(line.get("sent") and math.dist(line["true"], PLACES[robot]) < ARRIVED)

    try:
        for robot in PLACES:
            what = f"clock, scan and poses of {robot}"
            wait_until(lambda robot=robot: is_seen(robot), what, PATIENCE)
        for robot in PLACES:
            wait_until(lambda robot=robot: is_there(robot), f"{robot} at its place", PATIENCE)
    finally:
        peer.end()


def test_the_base_station_s_doctor_finds_the_door_in_order(door: Fleet) -> None:
    # Its exit status is also of what else it finds on a busy machine.
    command = "rosrun rocon_gateway doctor; true"
    said = door.execute("aadiworkstation", "sh", "-c", command)
    assert re.search(r"door to ROS 2, /ros2_door: (\d+) of \1 states are in order", said), said
