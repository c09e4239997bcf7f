"""A fleet with the door to ROS 2: a node of rclpy sends goals, robots drive and arrive; a stop of ROS 2 holds them."""

import contextlib
import json
import math
import os
import subprocess
from pathlib import Path

import pytest

from pioneer_harness.wait import wait_until

pytest.importorskip("cyclonedds", reason="the door to ROS 2 is not installed")

HERE = Path(__file__).parent
ROOT = Path(__file__).resolve().parents[5]
PEER = ROOT / ".setup" / "ros2-peer" / "bin" / "python3"
DOOR_TESTS = ROOT / "catkin_ws" / "src" / "pioneer_ros2" / "test" / "e2e"
STOP = DOOR_TESTS / "stop.py"
VELOCITIES = DOOR_TESTS / "peer.py"
NAV2_FLEET = "robots: [{name: pioneer1, navigation: none}, {name: pioneer2}]"
START_UP, DRIVE = 120.0, 90.0
GOALS = {"pioneer1": (3.5, -3.0), "pioneer2": (-2.5, -0.5)}
ARRIVED = 0.5
"""Largest distance of an arrived robot from its goal, and of the pose it believes in from the true one [m]."""
SAMPLES, STANDS = 4, 0.02
"""A robot stands if so many positions, half a second apart, are within this distance [m]."""

pytestmark = [
    # Other tests remove network interfaces, after which nodes of ROS 2 that were started before get nothing any more.
    pytest.mark.alone,
    pytest.mark.skipif(
        not PEER.exists(), reason="no ROS 2 for the tests (PyPI has it for Python 3.11)"
    ),
]


class Driver:
    """A process of rclpy that sends goals; keeps what it printed last of each robot."""

    def __init__(self, goals, log):
        words = [str(word) for name, place in goals.items() for word in (name, *place)]
        self.log = log
        self.output = log.open("wb")
        command = [str(PEER), str(HERE / "ros2_driver.py"), *words]
        self.process = subprocess.Popen(
            command, env=alone(), stdout=self.output, stderr=self.output
        )

    def lines(self, name):
        """Returns all lines about a robot."""
        assert self.process.poll() is None, self.log.read_text()
        whole = self.log.read_text().rpartition("\n")[0]
        lines = [json.loads(line) for line in whole.splitlines() if line[:1] == "{"]
        return [line for line in lines if line["robot"] == name]

    def newest(self, name):
        """Returns the newest line about a robot; empty before the first."""
        return next(reversed(self.lines(name)), {})

    def end(self):
        self.process.kill()
        self.process.wait()
        self.output.close()


def alone():
    """Returns the environment without ROS 1's Python path."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


@pytest.fixture
def domain(monkeypatch):
    """Chooses a domain, 60 to 79, which no other file of tests uses."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(60 + os.getpid() % 20))


@pytest.fixture
def processes():
    """Yields a list; ends its entries."""
    with contextlib.ExitStack() as stack:
        yield stack


def test_two_robots_arrive_at_goals_of_rclpy_and_a_stop_of_ros_2_holds_them(
    start, domain, processes, tmp_path
):
    fleet = start("--robots", 2, "--world", "small_world", "--ros2", command="fleet")
    driver = Driver(GOALS, tmp_path / "driver.log")
    processes.callback(driver.end)
    fleet.await_words("2 robots are ready in small_world", START_UP)

    def has_arrived(name):
        line = driver.newest(name)
        if not (line.get("sent") and line["believed"]):
            return False
        is_there = math.dist(line["true"], GOALS[name]) < ARRIVED
        return is_there and math.dist(line["true"], line["believed"]) < ARRIVED

    for name in GOALS:
        wait_until(lambda name=name: has_arrived(name), f"{name} at its goal", DRIVE)

    back = Driver({"pioneer1": GOALS["pioneer2"]}, tmp_path / "back.log")
    processes.callback(back.end)

    def is_far():
        place = back.newest("pioneer1").get("true")
        return place and math.dist(place, GOALS["pioneer1"]) > ARRIVED

    wait_until(is_far, "pioneer1 under way", DRIVE)
    stop = subprocess.Popen([str(PEER), str(STOP), "/estop", "true"], env=alone())
    processes.callback(stop.wait)
    processes.callback(stop.kill)

    def stands():
        places = [line["true"] for line in back.lines("pioneer1")[-SAMPLES:]]
        return all(math.dist(places[-1], place) < STANDS for place in places)

    wait_until(stands, "pioneer1 held", DRIVE)
    held_at = back.newest("pioneer1")["true"]
    assert math.dist(held_at, GOALS["pioneer2"]) > ARRIVED, "it was held under way"


def test_a_robot_without_navigation_is_driven_by_stamped_velocities_of_ros_2(
    start, domain, processes, tmp_path
):
    file = tmp_path / "nav2_fleet.yaml"
    file.write_text(NAV2_FLEET)
    fleet = start("--fleet", file, "--world", "small_world", "--ros2", command="fleet")
    fleet.await_words("2 robots are ready in small_world", START_UP)
    watcher = Driver({"pioneer1": GOALS["pioneer1"]}, tmp_path / "watcher.log")
    processes.callback(watcher.end)
    wait_until(lambda: watcher.newest("pioneer1").get("true"), "its true position", DRIVE)
    began = watcher.newest("pioneer1")["true"]
    log = processes.enter_context((tmp_path / "velocities.log").open("wb"))
    command = [str(PEER), str(VELOCITIES), "stamped"]
    velocities = subprocess.Popen(command, env=alone(), stdout=log, stderr=log)
    processes.callback(velocities.wait)
    processes.callback(velocities.kill)

    def has_moved():
        return math.dist(watcher.newest("pioneer1")["true"], began) > ARRIVED

    wait_until(has_moved, "pioneer1 under way", DRIVE)
    assert watcher.newest("pioneer1")["believed"] is None, "there is no amcl"
