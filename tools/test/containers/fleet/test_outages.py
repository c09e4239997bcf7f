"""Computers stop, die or lose their network while all robots drive: they recover, and the others are not affected.

A robot is undisturbed if it reaches every waypoint of its round and its computer was never without odometry for longer
than the time after which the robot stops (`errand`).
"""

import re
from collections.abc import Iterator

import pytest
from errand import ACROSS, Errands, finishes
from tested_fleet import PATIENCE, Fleet

from pioneer_harness.wait import wait_until

ALL = (1, 2, 3, 4, 5)
BASE = "aadiworkstation"
HUB = "rocon_hub/hub.py"
SIMULATOR = "pioneer_gazebo/pioneer_gazebo_server"


@pytest.fixture
def errands(driving: Fleet) -> Iterator[Errands]:
    made = Errands(driving)
    yield made
    made.close()


@pytest.fixture(scope="module", autouse=True)
def at_home(driving: Fleet) -> None:
    """Drops the waypoints that robots were sent to earlier, so that they turn back."""
    for number in ALL:
        driving.execute(
            f"aadi{number}", "rosservice", "call", f"/pioneer{number}/map_goal_client/clear"
        )


def speed(fleet: Fleet, number: int) -> float:
    """Returns a robot's speed in the simulator [m/s]."""
    said = fleet.execute(
        BASE, "rosservice", "call", "/gazebo/get_model_state", f"{{model_name: pioneer{number}}}"
    )
    x, y = (float(word) for word in re.findall(r"linear:\s*x: (\S+)\s*y: (\S+)", said)[0])
    return float((x * x + y * y) ** 0.5)


def stands(fleet: Fleet, *numbers: int) -> None:
    """Waits until robots that are no longer commanded have stopped."""
    for number in numbers:
        wait_until(
            lambda n=number: speed(fleet, n) < 0.01, f"standstill of robot {number}", PATIENCE
        )


def started(fleet: Fleet, computer: str) -> str:
    return fleet.docker("inspect", computer, "-f", "{{.State.StartedAt}}")


def test_a_computer_that_is_stopped_and_one_that_is_killed_come_back(errands: Errands) -> None:
    # From the places to which `up` has sent the robots, these are farther than a round.
    fleet, sent = errands.fleet, errands.send(*ALL, part=ACROSS)
    fleet.docker("kill", "aadi3")
    fleet.docker("stop", "aadi2")
    stands(fleet, 2, 3)
    fleet.docker("start", "aadi2")
    fleet.docker("start", "aadi3")
    for number in (1, 4, 5):
        sent[number].undisturbed()
    for number in (2, 3):
        finishes(fleet, number, ACROSS)


def test_a_computer_off_the_network_reaches_its_waypoints_once_it_is_back(errands: Errands) -> None:
    fleet, sent = errands.fleet, errands.send(*ALL)
    fleet.network("disconnect", "aadi4", "-f")
    stands(fleet, 4)
    fleet.network("connect", "aadi4", "--ip", "10.88.7.104")
    for number in (1, 2, 3, 5):
        sent[number].undisturbed()
    sent[4].reached()


def test_a_gateway_that_dies_starts_again_with_its_computer(errands: Errands) -> None:
    fleet, sent = errands.fleet, errands.send(*ALL)
    before = started(fleet, "aadi5")
    fleet.execute("aadi5", "pkill", "-KILL", "-f", "rocon_gateway/gateway.py")
    wait_until(lambda: started(fleet, "aadi5") != before, "start of aadi5 by the engine", PATIENCE)
    for number in (1, 2, 3, 4):
        sent[number].undisturbed()
    finishes(fleet, 5)


def test_nobody_notices_that_redis_and_then_the_hub_are_killed(errands: Errands) -> None:
    fleet, sent = errands.fleet, errands.send(*ALL)
    before = started(fleet, BASE)
    said = fleet.docker("logs", BASE).count("hub 'Pioneer Hub' on port")
    fleet.execute(BASE, "pkill", "-KILL", "redis-server")
    wait_until(
        lambda: fleet.docker("logs", BASE).count("hub 'Pioneer Hub' on port") == said + 1,
        "Redis",
        PATIENCE,
    )
    fleet.execute(BASE, "pkill", "-KILL", "-f", HUB)
    wait_until(
        lambda: fleet.docker("logs", BASE).count("hub 'Pioneer Hub' on port") == said + 2,
        "a hub",
        PATIENCE,
    )
    for errand in sent.values():
        errand.undisturbed()
    assert started(fleet, BASE) == before


def test_a_sixth_robot_joins(errands: Errands) -> None:
    fleet, sent = errands.fleet, errands.send(*ALL)
    fleet.pioneer("up", "--robots", "6", "--waypoints", "0")
    assert "pioneer6" in fleet.execute(BASE, "rosparam", "get", "/robot_names"), (
        "the fleet page would not show it"
    )
    joined = errands.send(6, part=ACROSS)
    for errand in sent.values():
        errand.undisturbed()
    joined[6].reached()


def test_all_six_drive_in_the_next_world_when_the_simulator_is_killed(errands: Errands) -> None:
    """Clock, odometry and robots restart; six robots drive there, including the one that joined the previous world."""
    fleet, sent = errands.fleet, errands.send(*ALL, 6)
    before = started(fleet, BASE)
    fleet.execute(BASE, "pkill", "-KILL", "-f", SIMULATOR)
    wait_until(
        lambda: started(fleet, BASE) != before, "start of the base station by the engine", PATIENCE
    )
    for errand in sent.values():
        errand.over()
    models = fleet.execute(BASE, "rosservice", "call", "/gazebo/get_world_properties")
    assert all(f"pioneer{number}" in models for number in (*ALL, 6)), models
    for errand in errands.send(*ALL, 6, part=ACROSS).values():
        errand.reached()
