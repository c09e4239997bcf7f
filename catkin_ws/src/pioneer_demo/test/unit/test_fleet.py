"""When a fleet counts as successful, and what is reported if it is not."""

import numpy as np
import pytest

from pioneer_demo.observer.fleet import Fleet, faults, stuck_report, time_limit
from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.report.view import live_lines
from pioneer_demo.scenario.scenario import Success
from pioneer_demo.scenario.waypoint import Leg
from pioneer_fleet.geometry import Pose
from pioneer_fleet.monitor.client import ClientState, Queue
from pioneer_fleet.monitor.state import Activity, State


@pytest.fixture
def fleet():
    robots = [RobotTrack("pioneer1"), RobotTrack("pioneer2")]
    for robot in robots:
        robot.assign([Leg(Pose(4.0, 0.0), np.zeros((1, 2)), 10.0)])
        robot.add_truth(1.0, Pose(0.0, 0.0))
    return Fleet(robots)


def report(robot, **counts):
    fields = {"reached": 0, "aborted": 0, "text": "", **counts}
    robot.add_queue(
        Queue(ClientState.DRIVING, 1, fields["reached"], fields["aborted"], fields["text"])
    )


def test_a_fleet_that_reached_everything_without_collision_has_no_fault(fleet):
    for robot in fleet.robots:
        report(robot, reached=1)
    assert fleet.finished
    assert faults(fleet, Success()) == []


def test_missed_waypoints_and_collisions_are_faults(fleet):
    report(fleet.robots[0], reached=1)
    report(fleet.robots[1], aborted=1)
    fleet.robots[0].collisions = 2
    assert fleet.finished
    assert faults(fleet, Success()) == [
        "pioneer1 collided twice",
        "pioneer2 reached 0 of 1 waypoints",
    ]


def test_who_is_stuck_is_named_with_what_it_says(fleet):
    report(fleet.robots[0], reached=1)
    report(fleet.robots[1], text="sent waypoint 1")
    fleet.robots[1].status = "move_base: rotating to clear"
    text = stuck_report(fleet, 90.0)
    assert "pioneer1" not in text
    assert (
        "pioneer2 at (0.00, 0.00), waypoint 1/1: sent waypoint 1; move_base: rotating to clear"
        in text
    )


def test_the_time_limit_grows_with_the_way(fleet):
    short = time_limit(fleet)
    fleet.robots[0].assign(fleet.robots[0].visits[:1][0:0] + [fleet.robots[1].visits[0].leg] * 3)
    assert time_limit(fleet) > short


def test_the_live_view_has_a_line_for_progress_simulator_and_each_robot(fleet):
    lines = live_lines(fleet)
    assert len(lines) == 4
    assert "4.0 m to go" in lines[2]
    assert "localisation error – m" in lines[2]


def test_the_state_says_what_a_robot_waits_for(fleet):
    robot = fleet.robots[0]
    assert RobotTrack("new").state.text == "not spawned"
    assert robot.state.text == "waiting for amcl"
    robot.add_correction(Pose(0.0, 0.0))
    assert robot.state.text == "waiting for the waypoint client"
    report(robot)
    assert robot.state.text == "driving"
    robot.monitor.said["move_base"] = State(Activity.BLOCKED, "blocked: the way is blocked")
    assert robot.state.text == "blocked: the way is blocked"
    robot.monitor.said.clear()
    robot.add_queue(Queue(ClientState.RESTING, 1, 0, 0, ""))
    assert robot.state.text == "resting"
    report(robot, reached=1)
    assert robot.state.text == "done"


def test_a_scenario_may_ask_for_more_or_less_than_a_demo(fleet):
    report(fleet.robots[0], reached=1)
    report(fleet.robots[1], aborted=1)
    fleet.began, fleet.ended = 1.0, 41.0
    fleet.robots[1].pose = Pose(0.3, 0.4)
    fleet.note_distance(fleet.robots[1])
    assert fleet.closest == pytest.approx(0.5)
    assert faults(fleet, Success(reached=0.0)) == []
    told = faults(
        fleet, Success(reached=0.0, seconds=30.0, closest_approach=0.6, localisation_error=0.1)
    )
    assert "it took 40.0 s, above 30 s" in told
    assert "two robots came within 0.50 m, below 0.6 m" in told
    assert "pioneer1: localisation error of nan m (95th percentile), above 0.1 m" in told
