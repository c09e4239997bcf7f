"""A minimal client of the ``move_base`` action: one goal at a time, and whether a server is connected."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from move_base_msgs.msg import (
    MoveBaseActionFeedback,
    MoveBaseActionGoal,
    MoveBaseActionResult,
    MoveBaseGoal,
)
from std_msgs.msg import Header

from simple_navigation_goals.queue import Outcome

_OUTCOMES = {
    GoalStatus.SUCCEEDED: Outcome.REACHED,
    GoalStatus.ABORTED: Outcome.ABORTED,
    GoalStatus.REJECTED: Outcome.ABORTED,
    GoalStatus.PREEMPTED: Outcome.CANCELLED,
    GoalStatus.RECALLED: Outcome.CANCELLED,
}
"""Outcome by a goal's final status; any other status is `Outcome.LOST`."""


class _Feedback(MoveBaseActionFeedback):  # type: ignore[misc]
    """Feedback that is never read; action clients subscribe to it nevertheless."""

    def deserialize(self, data: bytes) -> "_Feedback":
        return self


@dataclass(slots=True)
class _Goal:
    serial: int
    id: str
    listed: bool = False  #: whether the server's status has listed the goal
    ended: bool = False  #: whether its last status was final, so that the result will follow


class _Handle(Protocol):
    """The part of a `NodeHandle` that a client needs; rospy's nodes have a `RospyHandle`."""

    @property
    def name(self) -> str: ...

    @property
    def lockstep(self) -> object | None: ...

    def stamp(self) -> Any: ...

    def advertise(self, topic: str, kind: Any) -> Any: ...

    def subscribe(self, topic: str, kind: Any, take: Callable[[Any, str], object]) -> Any: ...


class MoveBase:
    """A client of the move_base action. It tracks only the goal sent last, from the moment it is sent.

    Args:
        node: the node that uses the client.
        name: name of the action.
        on_done: called with (serial, outcome, text) when the goal with number ``serial`` (see ``send``) has ended.
    """

    def __init__(
        self, node: _Handle, name: str, on_done: Callable[[int, Outcome, str], object]
    ) -> None:
        self._node, self._on_done = node, on_done
        self._goals = node.advertise(f"{name}/goal", MoveBaseActionGoal)
        self._cancels = node.advertise(f"{name}/cancel", GoalID)
        self._statuses = node.subscribe(f"{name}/status", GoalStatusArray, self._on_status)
        self._results = node.subscribe(f"{name}/result", MoveBaseActionResult, self._on_result)
        node.subscribe(f"{name}/feedback", _Feedback, lambda _message, _sender: None)
        self._serial = 0
        self._goal: _Goal | None = None
        self._server = ""

    def present(self) -> bool:
        """Returns whether a server is connected in both directions. Does not wait."""
        server = self._server
        if not server or self._node.lockstep is not None:
            return bool(server)  # lockstep needs no connection
        sending = self._goals.reaches(server) and self._cancels.reaches(server)
        return sending and self._statuses.hears(server) and self._results.hears(server)

    def send(self, goal: MoveBaseGoal) -> int:
        """Sends a goal, stops tracking the previous one, and returns the new goal's serial number."""
        self._serial += 1
        stamp = self._node.stamp()
        # The same format as actionlib's goal ids.
        self._goal = _Goal(
            self._serial, f"{self._node.name}-{self._serial}-{stamp.secs}.{stamp.nsecs}"
        )
        self._goals.publish(
            MoveBaseActionGoal(Header(0, stamp, ""), GoalID(stamp, self._goal.id), goal)
        )
        return self._serial

    def serial_of(self, goal_id: str) -> int:
        """Returns the serial number of a goal by its id; 0 if this client did not send it."""
        prefix = f"{self._node.name}-"
        serial = goal_id.removeprefix(prefix).partition("-")[0]
        return int(serial) if goal_id.startswith(prefix) and serial.isdecimal() else 0

    def cancel(self) -> None:
        """Cancels the goal sent last, and stops tracking it."""
        if self._goal is not None:
            self._cancels.publish(GoalID(id=self._goal.id))
        self._goal = None

    def forget(self) -> None:
        """Stops tracking the goal sent last, because its server has ended."""
        self._goal = None

    def _on_status(self, message: GoalStatusArray, sender: str) -> None:
        self._server = sender
        goal = self._goal
        if goal is None:
            return
        status = next(
            (one.status for one in message.status_list if one.goal_id.id == goal.id), None
        )
        if status is not None:
            goal.listed, goal.ended = True, status in _OUTCOMES
        elif goal.listed and not goal.ended:
            self._end(goal, Outcome.LOST, "move_base does not know the goal any more")

    def _on_result(self, message: MoveBaseActionResult, _sender: str) -> None:
        goal, status = self._goal, message.status
        if goal is not None and status.goal_id.id == goal.id:
            self._end(goal, _OUTCOMES.get(status.status, Outcome.LOST), status.text)

    def _end(self, goal: _Goal, outcome: Outcome, text: str) -> None:
        self._goal = None
        self._on_done(goal.serial, outcome, text)
