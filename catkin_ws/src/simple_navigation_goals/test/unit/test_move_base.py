"""How a move_base client interprets statuses and results."""

from types import SimpleNamespace
from typing import Any

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from genpy import Time
from move_base_msgs.msg import MoveBaseActionResult, MoveBaseGoal, MoveBaseResult

from simple_navigation_goals.move_base import MoveBase
from simple_navigation_goals.queue import Outcome

SERVER = "/robot/move_base"


class FakeHandle:
    """A node without connections: it keeps what is published, and a test injects the received messages."""

    name, lockstep = "/robot/client", None

    def __init__(self) -> None:
        self.takes: dict[str, Any] = {}
        self.sent: dict[str, list[Any]] = {}
        self.connected = True

    def stamp(self) -> Time:
        return Time(12, 34)

    def advertise(self, topic: str, kind: Any) -> Any:
        sent = self.sent.setdefault(topic, [])
        return SimpleNamespace(
            publish=sent.append, reaches=lambda node: self.connected and node == SERVER
        )

    def subscribe(self, topic: str, kind: Any, take: Any) -> Any:
        self.takes[topic] = take
        return SimpleNamespace(hears=lambda node: self.connected and node == SERVER)

    def status(self, *states: tuple[str, int]) -> None:
        listed = [GoalStatus(GoalID(id=name), state, "") for name, state in states]
        self.takes["move_base/status"](GoalStatusArray(status_list=listed), SERVER)

    def result(self, name: str, state: int, text: str = "") -> None:
        status = GoalStatus(GoalID(id=name), state, text)
        self.takes["move_base/result"](
            MoveBaseActionResult(status=status, result=MoveBaseResult()), SERVER
        )


@pytest.fixture
def node() -> FakeHandle:
    return FakeHandle()


@pytest.fixture
def ends() -> list[tuple[int, Outcome, str]]:
    return []


@pytest.fixture
def client(node: FakeHandle, ends: list[tuple[int, Outcome, str]]) -> MoveBase:
    return MoveBase(node, "move_base", lambda *end: ends.append(end))


@pytest.mark.parametrize(
    ("state", "outcome"),
    [
        (GoalStatus.SUCCEEDED, Outcome.REACHED),
        (GoalStatus.ABORTED, Outcome.ABORTED),
        (GoalStatus.REJECTED, Outcome.ABORTED),
        (GoalStatus.PREEMPTED, Outcome.CANCELLED),
        (GoalStatus.RECALLED, Outcome.CANCELLED),
        (GoalStatus.LOST, Outcome.LOST),
    ],
)
@pytest.mark.parametrize("listed", [True, False], ids=["after its status", "before any status"])
def test_a_result_ends_the_goal_once(
    client: MoveBase, node: FakeHandle, ends: Any, state: int, outcome: Outcome, listed: bool
) -> None:
    serial = client.send(MoveBaseGoal())
    (goal,) = node.sent["move_base/goal"]
    assert goal.goal_id.id == "/robot/client-1-12.34"
    if listed:
        node.status((goal.goal_id.id, GoalStatus.ACTIVE))
    for _ in range(2):
        node.result(goal.goal_id.id, state, "why")
    assert ends == [(serial, outcome, "why")]


def test_a_goal_that_the_server_no_longer_lists_is_lost(
    client: MoveBase, node: FakeHandle, ends: Any
) -> None:
    serial = client.send(MoveBaseGoal())
    (goal,) = node.sent["move_base/goal"]
    node.status()
    assert ends == [], "it may not have come yet"
    node.status((goal.goal_id.id, GoalStatus.ACTIVE))
    node.status(("/another-1", GoalStatus.ACTIVE))
    assert [end[:2] for end in ends] == [(serial, Outcome.LOST)]


def test_a_goal_that_has_ended_by_its_status_waits_for_its_result(
    client: MoveBase, node: FakeHandle, ends: Any
) -> None:
    serial = client.send(MoveBaseGoal())
    (goal,) = node.sent["move_base/goal"]
    node.status((goal.goal_id.id, GoalStatus.SUCCEEDED))
    node.status()
    assert ends == []
    node.result(goal.goal_id.id, GoalStatus.SUCCEEDED)
    assert ends == [(serial, Outcome.REACHED, "")]


def test_what_is_said_of_a_goal_that_was_replaced_cancelled_or_forgotten_counts_for_nothing(
    client: MoveBase, node: FakeHandle, ends: Any
) -> None:
    client.send(MoveBaseGoal())
    client.send(MoveBaseGoal())
    first, second = (goal.goal_id.id for goal in node.sent["move_base/goal"])
    node.result(first, GoalStatus.PREEMPTED)
    client.cancel()
    assert [one.id for one in node.sent["move_base/cancel"]] == [second]
    node.result(second, GoalStatus.PREEMPTED)
    client.cancel()
    client.send(MoveBaseGoal())
    client.forget()
    node.result(node.sent["move_base/goal"][-1].goal_id.id, GoalStatus.SUCCEEDED)
    assert ends == []
    assert len(node.sent["move_base/cancel"]) == 1


def test_a_server_is_present_while_it_is_connected_both_ways(
    client: MoveBase, node: FakeHandle
) -> None:
    assert not client.present(), "no status has come"
    node.status()
    assert client.present()
    node.connected = False
    assert not client.present()


def test_a_goal_that_was_sent_is_known_by_its_id(node: FakeHandle, client: MoveBase) -> None:
    """A cancel of move_base's goal by its id tells only by that which goal it stops."""
    for serial in (1, 2):
        assert client.send(MoveBaseGoal()) == serial
        assert client.serial_of(node.sent["move_base/goal"][-1].goal_id.id) == serial
    for other in ("", "/rviz-1-12.34", "/robot/client", "/robot/client-x-12.34"):
        assert client.serial_of(other) == 0
