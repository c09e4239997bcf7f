"""What a robot is said to be doing: the same words and the same order everywhere."""

import pytest
from nav_bundle.msg import NavigationState

from pioneer_fleet.geometry import Pose
from pioneer_fleet.monitor.client import ClientState, Queue
from pioneer_fleet.monitor.conversions import state_from_message
from pioneer_fleet.monitor.state import Activity, State, state_of

DRIVING = Queue(ClientState.DRIVING, 1, 0, 0, "")
BLOCKED = State(Activity.BLOCKED, "blocked: the way is blocked")
WAITING = State(Activity.WAITING, "waiting: waits for pioneer2")


def queue(state: ClientState) -> Queue:
    return Queue(state, 1, 0, 0, "")


@pytest.mark.parametrize("activity", Activity, ids=lambda activity: activity.name)
def test_the_numbers_are_those_of_the_message(activity: Activity) -> None:
    assert getattr(NavigationState, activity.name) == activity


@pytest.mark.parametrize(
    ("state", "shown"),
    [
        (NavigationState.IDLE, False),
        (NavigationState.DRIVING, False),
        (NavigationState.RECOVERING, True),
        (NavigationState.BLOCKED, True),
        (NavigationState.WAITING, True),
        (NavigationState.LOST, True),
        (NavigationState.HELD, True),
        (NavigationState.FAILED, True),
        (99, True),
    ],
)
def test_only_a_robot_that_does_not_get_on_has_a_trouble(state: int, shown: bool) -> None:
    read = state_from_message(NavigationState(state=state, text="the reason"), {})
    assert read.trouble == ("the reason" if shown else "")


@pytest.mark.parametrize(
    ("state", "text"),
    [
        (ClientState.IDLE, "idle"),
        (ClientState.DRIVING, "driving"),
        (ClientState.RESTING, "resting"),
        (ClientState.WAITING_FOR_MOVE_BASE, "waiting for move_base"),
    ],
)
def test_without_a_reason_the_waypoint_client_decides(state: ClientState, text: str) -> None:
    assert state_of(queue(state), {}).text == text
    assert state_of(None, {}).text == "waiting for the waypoint client"


def test_move_base_says_why_a_robot_does_not_get_on() -> None:
    assert state_of(DRIVING, {"move_base": BLOCKED}) == BLOCKED
    assert state_of(DRIVING, {"move_base": State(Activity.DRIVING, "driving")}).text == "driving"


def test_the_right_of_way_says_first_why_a_robot_does_not_get_on() -> None:
    assert state_of(DRIVING, {"move_base": BLOCKED, "traffic": WAITING}) == WAITING
    driving = State(Activity.DRIVING, "driving")
    assert state_of(DRIVING, {"move_base": BLOCKED, "traffic": driving}) == BLOCKED


def test_a_robot_that_is_driven_by_hand_is_said_to_be() -> None:
    manual = State(Activity.MANUAL, "driven by hand")
    assert state_of(queue(ClientState.IDLE), {"move_base": manual}) == manual


def test_what_a_robot_waits_for_at_the_start_is_said() -> None:
    starting = {"move_base": State(Activity.STARTING, "starting: waiting for the map")}
    assert state_of(queue(ClientState.WAITING_FOR_MOVE_BASE), starting).text == (
        "starting: waiting for the map"
    )
    assert state_of(None, {"move_base": State(Activity.STARTING, "starting")}).text == (
        "waiting for the waypoint client"
    )


@pytest.mark.parametrize("action", ["move_base", "traffic"])
def test_a_robot_whose_action_server_has_died_waits_for_it(action: str) -> None:
    """The last state of a node that has ended is out of date: kill -9 leaves no other."""
    state = state_of(queue(ClientState.WAITING_FOR_MOVE_BASE), {action: WAITING})
    assert state == State(Activity.STARTING, f"waiting for {action}")


@pytest.mark.parametrize("reason", [NavigationState.WAY_BLOCKED, NavigationState.GOAL_OCCUPIED])
def test_a_robot_in_the_way_of_one_that_does_not_know_it_is_named(reason: int) -> None:
    message = NavigationState(
        state=NavigationState.BLOCKED, reason=reason, has_place=True, text="the reason"
    )
    message.place.x, message.place.y = 7.2, 6.8
    others = {"pioneer2": Pose(1.0, 6.8), "pioneer3": Pose(7.5, 6.8)}
    assert state_from_message(message, others).text == "the reason: pioneer3 is there"
    assert state_from_message(message, {"pioneer2": others["pioneer2"]}).text == "the reason"
    message.robot = "pioneer3"
    assert state_from_message(message, others).text == "the reason"
