"""The action server: a cancel that comes while a goal waits for a transform holds for that goal, too."""

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseActionGoal

from nav_bundle.move_base.action_server import ActionServer

NOW = 100.0


class Server:
    """An action server without a master; ``during`` happens while a goal waits."""

    def __init__(self, during: Callable[["Server"], object], fault: str = "") -> None:
        self.passed: list[MoveBaseActionGoal] = []
        self.cancels: list[GoalID] = []
        self.refused: list[GoalStatus] = []
        self._during, self._fault = during, fault
        self.server = ActionServer.__new__(ActionServer)
        self.server._goal_fault, self.server._future_limit = self._wait, 1.0
        self.server._cancels_of_all = 0
        self.server._pass_goal, self.server._pass_cancel = self.passed.append, self.cancels.append
        self.server.action_server = SimpleNamespace(
            publish_result=lambda status, _: self.refused.append(status), lock=threading.RLock()
        )

    def _wait(self, _: PoseStamped) -> str:
        self._during(self)
        return self._fault

    def send(self) -> None:
        self.server._on_goal(MoveBaseActionGoal(goal_id=GoalID(id="of this test")))

    def cancel(self, **fields: Any) -> None:
        self.server._on_cancel(GoalID(**fields))


@pytest.fixture(autouse=True)
def _clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(NOW))
    monkeypatch.setattr(rospy, "logwarn_throttle", lambda *_: None)


def test_a_goal_that_waits_while_all_goals_are_cancelled_does_not_begin() -> None:
    """It used to be driven to after the stop, since the cancel found no goal."""
    server = Server(lambda server: server.cancel())
    server.send()
    assert server.passed == []
    assert [status.status for status in server.refused] == [GoalStatus.RECALLED]
    assert server.refused[0].goal_id.id == "of this test"
    assert server.cancels == [GoalID()]


def test_no_cancel_comes_between_the_decision_and_the_goal() -> None:
    """It would find no goal, and the goal would begin after it."""
    server = Server(lambda _: None)
    happened: list[str] = []
    stopping = threading.Thread(target=server.cancel)

    def begin(_: MoveBaseActionGoal) -> None:
        stopping.start()
        stopping.join(0.2)
        happened.append("goal")

    server.server._pass_goal = begin
    server.server._pass_cancel = lambda _: happened.append("cancel")
    server.send()
    stopping.join()
    assert happened == ["goal", "cancel"]


def test_a_cancel_before_the_goal_does_not_hold_for_it() -> None:
    server = Server(lambda _: None)
    server.cancel()
    server.send()
    assert len(server.passed) == 1
    assert server.refused == []


def test_cancels_by_id_and_by_stamp_are_left_to_actionlib() -> None:
    """It keeps both until the goal comes."""

    def cancel(server: Server) -> None:
        server.cancel(id="another")
        server.cancel(stamp=rospy.Time(1.0))
        server.cancel(stamp=rospy.Time(NOW + 60.0))

    server = Server(cancel)
    server.send()
    assert len(server.passed) == 1
    assert len(server.cancels) == 2


def test_a_goal_that_cannot_be_accepted_is_aborted_with_the_reason_also_after_a_cancel() -> None:
    server = Server(lambda server: server.cancel(), fault="no transform")
    server.send()
    assert server.passed == []
    assert [(each.status, each.text) for each in server.refused] == [
        (GoalStatus.ABORTED, "no transform")
    ]
