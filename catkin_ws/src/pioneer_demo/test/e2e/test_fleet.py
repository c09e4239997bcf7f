"""A fleet that stays up: listed by ``./pioneer status``, driven by goals and by keyboard, ended by Ctrl-C."""

import json
import math
import os
import pty
import signal
import subprocess
from pathlib import Path

import pytest

from pioneer_harness.proc import has_variable
from pioneer_harness.wait import wait_until

PIONEER = Path(__file__).resolve().parents[5] / "pioneer"
START_UP, DRIVE, COMMAND = 120.0, 60.0, 30.0
GOAL = 0.5
"""Largest distance [m] of a stopped robot from its goal, and of its estimated pose from the true one."""


def status(fleet):
    """Returns the entry of this fleet in ``./pioneer status``; other fleets may be running."""
    command = [PIONEER, "status", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=COMMAND, check=False)
    fleets = json.loads(done.stdout)["fleets"] if done.stdout else []
    return next((one for one in fleets if one["pid"] == fleet.process.pid), None)


def send(environment, x, y):
    goal = ["geometry_msgs/Twist", f"[{x}, {y}, 0.0]", "[0.0, 0.0, 0.0]"]
    command = ["rostopic", "pub", "-1", "/pioneer1/map_goal", *goal]
    subprocess.run(command, env=environment, check=True, timeout=COMMAND, capture_output=True)


def kill_while_driving(fleet, node):
    wait_until(lambda: abs(status(fleet)["robots"][0]["speed"]) > 0.2, "the robot under way", DRIVE)
    kill(fleet, node)


def kill(fleet, node):
    (victim,) = [pid for pid, line in fleet.processes().items() if f"__name:={node} " in line]
    os.kill(victim, signal.SIGKILL)


def test_a_robot_resumes_its_waypoints_when_its_computer_is_killed(start):
    goal = (3.5, -3.0)
    fleet = start("--robots", 1, "--world", "small_world", command="fleet")
    fleet.await_words("1 robot is ready in small_world", START_UP)
    (robot,) = status(fleet)["robots"]
    send({**os.environ, "ROS_MASTER_URI": robot["master"], "ROS_IP": "127.0.0.1"}, *goal)
    wait_until(lambda: abs(status(fleet)["robots"][0]["speed"]) > 0.2, "the robot under way", DRIVE)
    (gateway,) = [
        pid
        for pid, line in fleet.processes().items()
        if "__name:=gateway " in line and has_variable(pid, "ROBOT_NAME", "pioneer1")
    ]
    os.kill(gateway, signal.SIGKILL)
    fleet.await_words("pioneer1's computer is started again and resumes its waypoints", DRIVE)
    wait_until(lambda: status(fleet)["robots"][0]["reached"] == 1, "the goal", DRIVE)
    (robot,) = status(fleet)["robots"]
    assert math.dist(goal, robot["pose"][:2]) < GOAL
    fleet.interrupt()


@pytest.fixture
def keyboard():
    """Yields both ends of a terminal: one to type into, and one to pass to a command."""
    ours, theirs = pty.openpty()
    yield ours, theirs
    os.close(ours)
    os.close(theirs)


def test_a_fleet_stays_up_for_status_goals_killed_nodes_cmd_vel_and_teleop_until_ctrl_c(
    start, keyboard
):
    fleet = start("--robots", 1, "--world", "small_world", command="fleet")
    fleet.await_words("1 robot is ready in small_world", START_UP)
    (robot,) = status(fleet)["robots"]
    assert (robot["robot"], robot["reached"], robot["moving"]) == ("pioneer1", 0, False)
    assert robot["master"] in fleet.text()

    environment = {**os.environ, "ROS_MASTER_URI": robot["master"], "ROS_IP": "127.0.0.1"}
    world = subprocess.run(
        ["rosparam", "get", "/world_name"], env=environment, capture_output=True, check=True
    )
    assert world.stdout == b"small_world\n", "step 3's, through the gateways"

    x, y, _ = robot["pose"]
    send(environment, x, y)
    wait_until(
        lambda: status(fleet)["robots"][0]["reached"] == 1,
        "the goal, which is where it stands",
        DRIVE,
    )
    for count, (node, goal) in enumerate((("amcl", (3.5, -3.0)), ("move_base", (-2.5, -0.5))), 2):
        send(environment, *goal)
        kill_while_driving(fleet, node)
        wait_until(
            lambda n=count: status(fleet)["robots"][0]["reached"] == n,
            f"the goal without {node}",
            DRIVE,
        )
        (robot,) = status(fleet)["robots"]
        assert math.dist(goal, robot["pose"][:2]) < GOAL
        assert robot["localisation_error"] < GOAL
        assert f"pioneer1/{node} has died and is started again" in fleet.text()

    turn = ["/pioneer1/cmd_vel", "geometry_msgs/Twist", "[0.0, 0.0, 0.0]", "[0.0, 0.0, 0.5]"]
    publisher = subprocess.Popen(["rostopic", "pub", "-r", "10", *turn], env=environment)
    wait_until(
        lambda: status(fleet)["robots"][0]["moving"],
        "the robot that a command on cmd_vel turns",
        DRIVE,
    )
    publisher.send_signal(signal.SIGINT)
    publisher.wait(COMMAND)
    wait_until(
        lambda: not status(fleet)["robots"][0]["moving"],
        "its stop, since no more commands come",
        DRIVE,
    )

    ours, theirs = keyboard
    teleop = subprocess.Popen(
        ["rosrun", "pioneer_fleet", "teleop", "pioneer1"],
        env=environment,
        stdin=theirs,
        stdout=subprocess.DEVNULL,
    )
    os.write(ours, b"aa")
    wait_until(lambda: status(fleet)["robots"][0]["moving"], "the robot that turns", DRIVE)
    os.write(ours, b"q")
    assert teleop.wait(COMMAND) == 0
    wait_until(lambda: not status(fleet)["robots"][0]["moving"], "the robot's stop", DRIVE)

    subprocess.run(
        ["rosparam", "set", "/pioneer1/amcl/odom_model_type", "hover"], env=environment, check=True
    )
    kill(fleet, "amcl")
    wait_until(lambda: status(fleet)["faults"], "the fault of an amcl that cannot start", DRIVE)
    assert "pioneer1/amcl keeps dying" in fleet.text()
    assert "hover" in fleet.text()
    assert "odom_model_type" in status(fleet)["faults"][0]
    subprocess.run(
        ["rosparam", "set", "/pioneer1/amcl/odom_model_type", "diff"], env=environment, check=True
    )

    fleet.interrupt()
    assert status(fleet) is None
