"""A driving robot of a real fleet stands in time when it loses an input, and ``./pioneer status`` says which.

It takes two minutes and needs a machine with little else to do: scans that come late by themselves are a reason, too.
``./pioneer test --soak`` runs it.
"""

import json
import math
import os
import signal
import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import pytest
from input_tap import InputTap

from pioneer_fleet.registry import running_fleets
from pioneer_harness.error import WaitError
from pioneer_harness.wait import wait_until

ROOT = Path(__file__).resolve().parents[5]
PIONEER = ROOT / "pioneer"
WORLD = ROOT / "catkin_ws/src/pioneer_traffic/test/rostest/corridor.world"
pytestmark = pytest.mark.soak

START_UP, WAIT, COMMAND = 120.0, 30.0, 30.0
ENDS = (0.6, 6.2)
"""Where the robot drives to and fro, x [m]; its partner stands beyond."""
PARTNER = 8.4
LEGS = 30
"""Waypoints that the robot gets: more than it can reach during the test."""
USELESS_MAP = 3.0
"""Time for which the robot has to drive on with a map that cannot be used [s]."""
MARGIN = 1.2
"""Time for braking (0.4 s), for the messages' ways and for a loaded machine [s]."""
STILL = 0.05
"""How far a robot that stands may move while it comes to rest [m]."""
REASON_WITHIN = 10.0
"""Time from standstill to the reason in the status, which is written each second; a coordinator starts in 3 s [s]."""
CLOCK = 2.5
TRANSFORM, TRANSFORM_AHEAD = 0.5, 1.0
"""transform_tolerance, and by how much amcl's transform is ahead [s]."""
SCAN, UPDATE, ODOMETRY = 0.4, 0.2, 0.5
"""expected_update_rate, one update of the costmap, odom_timeout [s]."""
COORDINATOR = 0.5
"""Time from the coordinator's death to the end of move_base's goal [s]."""
REPORTS, FREE_WAY = 2.0, 20.0
"""Time without reports after which a robot counts as lost, and for the way to it that remains free, at 0.4 m/s [s]."""
NEAREST = 1.0
"""How near the robot may come to a partner that sends no reports [m]."""


class Loss(NamedTuple):
    """What a robot has to do when an input is lost or useless."""

    within: float  #: documented time until a zero velocity is commanded [s]
    words: str  #: of the reason in the status


INPUTS = {
    "no scans": Loss(SCAN, "base_scan observation buffer has not been updated"),
    "scans 0.6 s ahead": Loss(SCAN + UPDATE, "its newest is at"),
    "scans 5 s old": Loss(SCAN + UPDATE, "s in the past"),
    "scans in an unknown frame": Loss(SCAN + UPDATE, "nowhere"),
    "empty scans": Loss(SCAN + UPDATE, "none of its 0 ranges is a measurement"),
    "scans of NaN": Loss(SCAN + UPDATE, "ranges is a measurement"),
    "no odometry": Loss(ODOMETRY, "no odometry on"),
    "odometry without numbers": Loss(0.0, "odometry refused: linear.x"),
    "no transforms of the robot": Loss(TRANSFORM, "the newest transform from pioneer1/base_link"),
    "no clock": Loss(CLOCK, "/clock has stood still"),
}
"""Losses that the tap makes, by its name of the fault."""


@pytest.fixture
def fleet(start, tmp_path):
    """Yields two robots with right of way at the ends of a corridor in which they cannot pass each other."""
    robots = [
        {"name": "pioneer1", "pose": {"x": ENDS[0], "y": 0.0, "a": 0.0}},
        {"name": "pioneer2", "pose": {"x": PARTNER, "y": 0.0, "a": 3.14159}},
    ]
    file = tmp_path / "fleet.yaml"
    file.write_text(json.dumps({"robots": robots}))
    running = start("--fleet", file, "--world", WORLD, "--traffic", "--rtf", 1, command="fleet")
    running.await_words("2 robots are ready in corridor", START_UP)
    yield running
    running.interrupt()


def status(fleet):
    """Returns the entry of this fleet in ``./pioneer status``; other fleets may be running."""
    command = [PIONEER, "status", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=COMMAND, check=False)
    return next(one for one in json.loads(done.stdout)["fleets"] if one["pid"] == fleet.process.pid)


def printed():
    """Returns what ``./pioneer status`` prints."""
    command = [PIONEER, "status"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=COMMAND, check=False)
    return done.stdout


class Driver:
    """Keeps the robot driving, and checks what it does without an input."""

    def __init__(self, fleet, tap):
        self.fleet, self.tap = fleet, tap
        self.failures = []

    def state(self):
        """Returns the robot's state as the fleet writes it for ``./pioneer status``."""
        pid = self.fleet.process.pid
        (entry,) = [entry for entry in running_fleets() if entry["pid"] == pid]
        return entry["robots"][0]["state"]

    def check(self, name, loss, begin, end):
        """Takes an input away with ``begin``, checks that the robot stands and why, and gives it back with ``end``."""
        try:
            wait_until(lambda: self.tap.moves, f"{name}: the robot under way", WAIT)
            began = time.monotonic()
            begin()
            wait_until(lambda: self.tap.stands_since, f"{name}: standstill", WAIT)
            took = self.tap.stands_since - began
            assert took <= loss.within + MARGIN, f"{name}: it stood after {took:.2f} s"
            place = self.tap.position
            wait_until(lambda: loss.words in self.state(), f"{name}: {loss.words!r}", REASON_WITHIN)
            # On a busy machine, another reason may be shown in between: scans that are late, too.
            wait_until(
                lambda: loss.words in printed(), f"{name}: {loss.words!r} printed", REASON_WITHIN
            )
            moved = math.dist(place, self.tap.position)
            assert moved < STILL, f"{name}: it has moved on by {moved:.2f} m"
            print(f"{time.monotonic():.1f} {name}: {took:.2f} s, {self.state()}")
        except (AssertionError, WaitError) as error:
            self.failures.append(f"{name}: {error}; the status says {self.state()!r}")
            print(self.failures[-1])
        finally:
            end()

    def spoil(self, fault):
        self.tap.fault = fault

    def signal(self, node, number):
        """Sends a signal to a node of the robot."""
        words = f"/pioneer1-{node}-"
        (pid,) = [
            pid
            for pid, line in self.fleet.processes().items()
            if f"__name:={node} " in line and words in line
        ]
        os.kill(pid, number)


def test_a_robot_stands_in_time_without_an_input_and_status_names_it(fleet):
    robots = status(fleet)["robots"]
    tap = InputTap(status(fleet)["master"], robots[0]["master"], "pioneer1")
    driver = Driver(fleet, tap)
    try:
        tap.take_over()
        wait_until(tap.is_connected, "the tap's subscribers", WAIT)
        for leg in range(LEGS):
            tap.send(ENDS[1 - leg % 2], 0.0)
        for fault, loss in INPUTS.items():
            driver.check(
                fault, loss, lambda fault=fault: driver.spoil(fault), lambda: driver.spoil("")
            )
        driver.check(
            "no transform of the map",
            Loss(
                TRANSFORM + TRANSFORM_AHEAD, "the newest transform from pioneer1/base_link to map"
            ),
            lambda: driver.signal("amcl", signal.SIGSTOP),
            lambda: driver.signal("amcl", signal.SIGCONT),
        )
        check_a_useless_map(driver)
        check_a_coordinator_that_dies_without_a_map(driver)
        check_a_silent_partner(driver, robots[1]["master"])
        assert not driver.failures
    finally:
        tap.fault = ""
        tap.close()


def check_a_useless_map(driver):
    """A map that cannot be used is refused, and changes nothing."""
    tap = driver.tap
    wait_until(lambda: tap.moves, "the robot under way", WAIT)
    began = time.monotonic()
    tap.publish_useless_map()
    wait_until(
        lambda: any("the map is not used" in line for line in tap.lines), "its refusal", WAIT
    )
    wait_until(lambda: time.monotonic() - began > USELESS_MAP, "the robot that drives on", WAIT)
    if tap.stands_since is not None and time.monotonic() - tap.stands_since > 1.0:
        driver.failures.append(f"a useless map: the robot stands, {driver.state()!r}")


def check_a_coordinator_that_dies_without_a_map(driver):
    """The next coordinator waits for the map, and the robot with it."""
    driver.tap.change_rule("pull_hub_publisher.py", "map", "--cancel")
    driver.check(
        "no coordinator and no map",
        Loss(COORDINATOR, "no map has arrived"),
        lambda: driver.signal("coordinator", signal.SIGKILL),
        lambda: driver.tap.change_rule("pull_hub_publisher.py", "map"),
    )
    driver.fleet.await_words("pioneer1/coordinator has died and is started again", WAIT)


def check_a_silent_partner(driver, partner):
    """Its partner stands where the robot has to go, and cannot say where it drives: the robot stops before it."""
    tap = driver.tap
    tap.clear()
    tap.send(ENDS[0], 0.0)
    wait_until(
        lambda: math.dist(tap.position, (ENDS[0], 0.0)) < 0.5 and tap.stands_since,
        "the robot at its end of the corridor",
        2.0 * WAIT,
    )
    tap.send(PARTNER, 0.0)
    wait_until(lambda: tap.moves, "the robot under way", WAIT)
    tap.change_rule("flip-traffic", "--cancel", master=partner)
    words = "pioneer2 (sends no reports)"
    try:
        # It may stop in between, for a new plan.
        wait_until(
            lambda: tap.stands_since and words in driver.state(),
            f"the robot standing, and {words!r}",
            REPORTS + FREE_WAY + REASON_WITHIN,
        )
        wait_until(lambda: words in printed(), f"{words!r} printed", REASON_WITHIN)
        if math.dist(tap.position, (PARTNER, 0.0)) < NEAREST:
            driver.failures.append(f"no reports of the partner: it has come to {tap.position}")
    except WaitError as error:
        driver.failures.append(f"no reports of the partner: {error}; status: {driver.state()!r}")
    finally:
        tap.change_rule("flip-traffic", master=partner)
    wait_until(lambda: tap.moves, "the robot under way when its partner reports again", WAIT)
