"""When a fleet counts as successful, and what is reported if it is not."""

import numpy as np
import pytest
from nav_bundle.msg import NavigationState

from pioneer_demo.observer.fleet import Fleet, faults, stuck_report, time_limit
from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.report.view import live_lines, state_word
from pioneer_demo.scenario.scenario import Success
from pioneer_demo.scenario.waypoint import Leg
from pioneer_fleet.geometry import Pose
from pioneer_fleet.monitor.conversions import lack_from_state, trouble_from_state
from pioneer_fleet.monitor.monitor import ClientState, Queue


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
    assert state_word(RobotTrack("new")) == "not spawned"
    assert state_word(robot) == "waiting for amcl"
    robot.add_correction(Pose(0.0, 0.0))
    assert state_word(robot) == "waiting for client"
    report(robot)
    assert state_word(robot) == "driving"
    robot.monitor.troubles["move_base"] = "blocked: the way is blocked near (7.2, 6.8)"
    assert state_word(robot) == "blocked: the way is blocked near (7.2, 6.8)"
    robot.monitor.troubles.clear()
    robot.add_queue(Queue(ClientState.RESTING, 1, 0, 0, ""))
    assert state_word(robot) == "resting"
    report(robot, reached=1)
    assert state_word(robot) == "done"


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


@pytest.mark.parametrize(
    ("state", "shown"),
    [
        (NavigationState.IDLE, False),
        (NavigationState.DRIVING, False),
        (NavigationState.RECOVERING, True),
        (NavigationState.BLOCKED, True),
        (NavigationState.FAILED, True),
    ],
)
def test_a_robot_that_does_not_get_on_is_shown_with_move_base_s_reason(
    state: int, shown: bool
) -> None:
    message = NavigationState(state=state, text="the reason")
    assert trouble_from_state(message, {}) == ("the reason" if shown else "")


def test_what_a_robot_waits_for_at_the_start_is_shown(fleet) -> None:
    message = NavigationState(state=NavigationState.STARTING, text="starting")
    assert lack_from_state(message) == ""
    message.text = "starting: waiting for the map"
    assert trouble_from_state(message, {}) == ""
    robot = started(fleet)
    robot.monitor.lacks_at_start["move_base"] = lack_from_state(message)
    assert state_word(robot) == "starting: waiting for the map"


def started(fleet) -> RobotTrack:
    robot = fleet.robots[0]
    robot.visits.clear()
    robot.add_correction(Pose(0.0, 0.0))
    report(robot)
    return robot


def test_the_right_of_way_says_first_why_a_robot_does_not_get_on(fleet) -> None:
    robot = started(fleet)
    robot.monitor.troubles["move_base"] = "blocked: the way is blocked"
    assert state_word(robot) == "blocked: the way is blocked"
    robot.monitor.troubles["traffic"] = "waiting: waits for pioneer2"
    assert state_word(robot) == "waiting: waits for pioneer2"
    robot.monitor.troubles["traffic"] = ""
    assert state_word(robot) == "blocked: the way is blocked"


@pytest.mark.parametrize("action", ["move_base", "traffic"])
def test_a_robot_whose_action_server_has_died_waits_for_it(fleet, action: str) -> None:
    """The last state of a node that has ended is out of date: kill -9 leaves no other."""
    robot = started(fleet)
    robot.monitor.troubles[action] = "waiting: waits for pioneer2"
    robot.add_queue(Queue(ClientState.WAITING_FOR_MOVE_BASE, 1, 0, 0, f"{action} disconnected"))
    assert state_word(robot) == f"waiting for {action}"


@pytest.mark.parametrize("reason", [NavigationState.WAY_BLOCKED, NavigationState.GOAL_OCCUPIED])
def test_a_robot_in_the_way_of_one_that_does_not_know_it_is_named(reason: int) -> None:
    message = NavigationState(
        state=NavigationState.BLOCKED, reason=reason, has_place=True, text="the reason"
    )
    message.place.x, message.place.y = 7.2, 6.8
    others = {"pioneer2": Pose(1.0, 6.8), "pioneer3": Pose(7.5, 6.8)}
    assert trouble_from_state(message, others) == "the reason: pioneer3 is there"
    assert trouble_from_state(message, {"pioneer2": others["pioneer2"]}) == "the reason"
    message.robot = "pioneer3"
    assert trouble_from_state(message, others) == "the reason"
