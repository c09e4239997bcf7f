"""Reasons: what blocks a robot is named with its place, and the same words go everywhere."""

import itertools
import math

import numpy as np
import pytest
import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from drawn_room import grid_from_text
from hypothesis import given
from hypothesis import strategies as st
from nav_bundle.msg import NavigationState

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.config import costmap_config_from_parameters
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.layer import Observation
from nav_bundle.move_base.config import setup_from_parameters
from nav_bundle.move_base.navigator import Navigator, Report, Sight
from nav_bundle.move_base.reason import (
    NO_SENSOR_DATA,
    Code,
    Condition,
    Reason,
    failure,
    way_blocked,
)
from nav_bundle.move_base.state_machine import Trigger
from nav_bundle.move_base.state_topics import _STATES, diagnostic_from_report, message_from_report
from nav_bundle.planning.followed_plan import FollowedPlan
from nav_bundle.planning.plan_choice import PlanChoice

ROOM = ["####################", *["#..................#"] * 14, "####################"]
GOAL = Pose(1.6, 0.8)


def seen_room(*points: tuple[float, float]) -> Costmap:
    """Returns a room of 2 x 1.6 m in which a laser sees obstacles at ``points``."""
    laser = {"topic": "base_scan", "marking": True, "clearing": True}
    parameters = {
        "static_map": True,
        "robot_radius": 0.2,
        "inflation_radius": 0.5,
        "observation_sources": "laser",
        "laser": laser,
    }
    costmap = Costmap(costmap_config_from_parameters(parameters, "test"))
    costmap.set_map(grid_from_text(ROOM, 0.1))
    source = costmap.config.layers[1].sources[0]
    seen = Observation(source, 0.5, 0.8, np.array(points, np.float64).reshape(-1, 2))
    costmap.update(Pose(0.5, 0.8), [seen])
    return costmap


def line_to(goal: Pose) -> np.ndarray:
    x = np.arange(0.5, goal.x, 0.05)
    return np.column_stack([x, np.full(len(x), goal.y), np.zeros(len(x))])


def test_an_obstacle_on_the_goal_is_named() -> None:
    reason = failure(Trigger.PLANNING, seen_room((1.6, 0.8)), GOAL, Pose(), None, {})
    assert (reason.code, reason.place) == (Code.GOAL_OCCUPIED, (1.6, 0.8))
    assert reason.text == "the goal is occupied by something that the map does not show"


def test_a_robot_on_the_goal_is_named() -> None:
    robots = {"pioneer2": Pose(0.5, 0.8), "pioneer3": Pose(1.7, 0.8)}
    reason = failure(Trigger.PROGRESS, seen_room((1.6, 0.8)), GOAL, Pose(), None, robots)
    assert (reason.robot, reason.text) == ("pioneer3", "the goal is occupied by pioneer3")


def test_an_obstacle_across_the_way_is_named_with_its_place() -> None:
    costmap = seen_room(*((1.05, y) for y in np.arange(0.1, 1.5, 0.05)))
    choice = PlanChoice()
    choice.followed = FollowedPlan(line_to(GOAL))
    choice.check(costmap, Pose(0.5, 0.8), 1.0)
    assert choice.take_discovery()
    assert not choice.take_discovery()
    reason = failure(Trigger.PLANNING, costmap, GOAL, Pose(0.5, 0.8), choice.last_blocked, {})
    assert reason.code is Code.WAY_BLOCKED
    assert (
        reason.sentence()
        == "The way is blocked near (0.8, 0.8) by something that the map does not show."
    )


def test_a_goal_in_a_wall_of_the_map_is_no_obstacle_that_the_map_does_not_show() -> None:
    reason = failure(Trigger.PLANNING, seen_room(), Pose(0.02, 0.8), Pose(), None, {})
    assert reason.code is Code.GOAL_INVALID


@pytest.mark.parametrize(
    ("trigger", "code"),
    [
        (Trigger.PUSHING, Code.DOES_NOT_MOVE),
        (Trigger.SENSORS, Code.NO_SENSOR_DATA),
        (Trigger.PLANNING, Code.NO_WAY),
        (Trigger.CONTROLLING, Code.NO_VALID_VELOCITY),
        (Trigger.PROGRESS, Code.NO_PROGRESS),
        (Trigger.OSCILLATION, Code.NO_PROGRESS),
        (Trigger.TIME, Code.TOO_LATE),
    ],
)
def test_every_failure_has_a_reason(trigger: Trigger, code: Code) -> None:
    reason = failure(trigger, seen_room(), GOAL, Pose(1.0, 0.8), None, {})
    assert reason.code is code
    assert reason.sentence().endswith(".")


def test_topic_and_diagnostics_say_the_same() -> None:
    report = Report(
        Condition.BLOCKED, way_blocked((7.23, 6.81), {"pioneer3": Pose(7.5, 6.8)}), 12.5
    )
    message = message_from_report(report, "map", 20.0)
    assert message.text == "blocked: the way is blocked near (7.2, 6.8) by pioneer3"
    assert (message.state, message.reason) == (NavigationState.BLOCKED, NavigationState.WAY_BLOCKED)
    assert (message.robot, message.place.x, message.has_place) == ("pioneer3", 7.23, True)
    assert message.since == rospy.Time.from_sec(12.5)
    status = diagnostic_from_report(report)
    assert (status.level, status.message) == (DiagnosticStatus.WARN, message.text)


def test_every_code_is_the_reason_of_some_failure() -> None:
    """A code that is never sent makes programs wait for it for nothing."""
    start = Pose(0.5, 0.8)
    reasons = [failure(trigger, seen_room(), GOAL, start, None, {}) for trigger in Trigger]
    reasons.append(failure(Trigger.PLANNING, seen_room((1.6, 0.8)), GOAL, start, None, {}))
    reasons.append(failure(Trigger.PLANNING, seen_room(), Pose(0.02, 0.8), start, None, {}))
    reasons.append(failure(Trigger.PLANNING, seen_room(), GOAL, start, (1.0, 0.8), {}))
    assert {reason.code for reason in reasons} == set(Code) - {Code.NONE}


class BlindRobot:
    """A robot with a goal that an input does not allow to drive."""

    def __init__(self) -> None:
        footprint = {"robot_radius": 0.2}
        parameters = {"global_costmap": footprint, "local_costmap": footprint}
        room = seen_room()
        setup = setup_from_parameters(parameters, "test")
        self.navigator = Navigator(setup, room, room, lambda: None)
        self.navigator.begin(GOAL, Pose(0.5, 0.8), 1.0)

    def text(self, fault: str, now: float) -> str:
        """Runs a cycle with ``fault``; returns what is reported then."""
        self.navigator.cycle(Sight(Pose(0.5, 0.8), fault=fault), now)
        return self.navigator.report.text()


MISSING = "blocked: sensor data, odometry or transforms are missing"


def test_a_robot_that_an_input_stops_names_the_input() -> None:
    robot = BlindRobot()
    assert robot.text("no scans for 0.4 s.", 1.1) == f"{MISSING}: no scans for 0.4 s"
    assert robot.text("no scans for 3.0 s.", 4.0) == f"{MISSING}: no scans for 0.4 s"
    assert robot.text("no scans for 6.0 s.", 6.5) == f"{MISSING}: no scans for 6.0 s"
    assert robot.navigator.report.since == 1.1


def test_a_fault_that_follows_another_is_named_within_a_second() -> None:
    """A first fault of one cycle, as a late message is on a loaded machine, used to be named for 5 s."""
    robot = BlindRobot()
    robot.text("no odometry on odom", 1.1)
    assert robot.text("no scans for 0.4 s", 1.5) == f"{MISSING}: no odometry on odom"
    assert robot.text("no scans for 1.0 s", 2.1) == f"{MISSING}: no scans for 1.0 s"


@given(st.lists(st.tuples(st.floats(0.0, 0.3), st.sampled_from("abc"), st.integers(0, 9))))
def test_faults_that_take_turns_change_the_text_once_a_second(
    faults: list[tuple[float, str, int]],
) -> None:
    robot = BlindRobot()
    begin = now = 2.0
    texts = [robot.text("none", now)]
    for pause, fault, figure in faults:
        now += pause
        texts.append(robot.text(f"{fault} {figure}", now))
    changes = sum(after != before for before, after in itertools.pairwise(texts))
    assert changes <= now - begin


def test_a_reason_without_a_place_says_so() -> None:
    message = message_from_report(Report(Condition.BLOCKED, NO_SENSOR_DATA), "map", 1.0)
    assert not message.has_place
    assert math.isnan(message.place.x)


def test_the_message_has_every_state_and_every_reason() -> None:
    assert set(_STATES) == set(Condition)
    names = {code.name if code else "NO_REASON": int(code) for code in Code}
    assert {name: getattr(NavigationState, name) for name in names} == names
    assert diagnostic_from_report(Report(Condition.DRIVING, Reason())).level == DiagnosticStatus.OK
