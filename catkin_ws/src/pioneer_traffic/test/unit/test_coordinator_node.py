"""The coordinator node without a master: each way to stop its robot reaches the pilot, and a stop is kept."""

import queue
import threading
from types import SimpleNamespace
from typing import Any

import pytest
import rospy
from actionlib_msgs.msg import GoalID
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseGoal

from nav_bundle.base.transform import DisconnectedError, Transform
from pioneer_traffic.config import PilotConfig
from pioneer_traffic.coordinator_node import CoordinatorNode, _GoalArrived
from pioneer_traffic.event import CancelRequested, Event, MoveBaseTaken, NewRoadmap
from pioneer_traffic.goal_server import GoalServer
from pioneer_traffic.pilot import Pilot
from pioneer_traffic.roadmap import Roadmap
from simple_navigation_goals.queue import Outcome

NAME, OTHER = "/pioneer1/coordinator", "/rviz"
START = 1000.0
ROW = Roadmap(
    [(float(place), 0.0) for place in range(9)],
    [[other for other in (place - 1, place + 1) if 0 <= other < 9] for place in range(9)],
)


class Robot:
    """A coordinator node whose topics, transforms and action server are the test's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = START
        self.connected = True  #: whether tf knows where the robot is
        self.target: PoseStamped | None = None  #: goal that waits to be taken
        self.cancelled = ""  #: why the action server's goal is to be cancelled
        self.forgotten = 0  #: how often the action server was reset after a jump of the clock
        self.sent: list[MoveBaseGoal] = []
        self.cancels = 0
        self.ends: list[Outcome] = []
        self.kept = ""
        self.reports: list[Any] = []
        monkeypatch.setattr(rospy, "get_time", lambda: self.now)
        monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time.from_sec(self.now))
        for name in ("logwarn", "loginfo"):
            monkeypatch.setattr(rospy, name, lambda *_: None)
        node = self.node = CoordinatorNode.__new__(CoordinatorNode)
        node._robot, node._name, node._base, node._fleet = "a", NAME, "base_link", []
        node._reporting, node._kept, node._events = set(), [], queue.SimpleQueue()
        node._wake = threading.Event()
        node._pilot, node._roadmap = Pilot("a", PilotConfig()), None
        node._stepped_at, node._target, node._shown = float("-inf"), None, None
        node._listener = SimpleNamespace(lookup=self._lookup)  # type: ignore[assignment]
        node._lost = SimpleNamespace(warn=lambda _: None, end=lambda: None)  # type: ignore[assignment]
        node._hold = SimpleNamespace(keep=lambda reason: setattr(self, "kept", reason))  # type: ignore[assignment]
        node._publisher = SimpleNamespace(publish=self.reports.append)
        node._state = SimpleNamespace(publish=lambda _: None)
        node._move_base = SimpleNamespace(  # type: ignore[assignment]
            present=lambda: True,
            send=self.sent.append,
            cancel=self._cancel,
            serial_of=lambda name: 1 if name == "the stretch" else 0,
        )
        node._server = SimpleNamespace(  # type: ignore[assignment]
            forget=self._forget,
            take=self._take,
            cancelled=lambda: self.cancelled,
            finish=lambda outcome, _: self.ends.append(outcome),
        )

    def _lookup(self, *_: str) -> Transform:
        if not self.connected:
            raise DisconnectedError("no transform")
        return Transform()

    def _cancel(self) -> None:
        self.cancels += 1

    def _forget(self) -> None:
        self.forgotten += 1

    def _take(self) -> PoseStamped | None:
        target, self.target = self.target, None
        return target

    def step(self, seconds: float = 0.2) -> None:
        self.now += seconds
        self.node.step()

    def drive(self) -> None:
        """Sends the robot to the row's end, and lets it begin."""
        self.node._events.put(NewRoadmap(ROW))
        self.target = PoseStamped()
        self.target.pose.position.x = 8.0
        self.target.pose.orientation.w = 1.0
        self.node._on_goal()
        for _ in range(20):
            self.step()
        assert self.sent

    def events(self) -> list[Event]:
        return self.node._take_events()


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Robot:
    return Robot(monkeypatch)


STOPS = {
    "all goals of traffic": lambda robot: robot.node._on_cancel(GoalID(), OTHER),
    "traffic by stamp": lambda robot: robot.node._on_cancel(
        GoalID(stamp=rospy.Time.from_sec(robot.now)), OTHER
    ),
    "traffic by id": lambda robot: setattr(robot, "cancelled", "the goal was cancelled"),
    "the end of the client": lambda robot: setattr(robot, "cancelled", "/rviz has ended"),
    "all goals of move_base": lambda robot: robot.node._on_move_base_cancel(GoalID(), OTHER),
    "move_base by stamp": lambda robot: robot.node._on_move_base_cancel(
        GoalID(stamp=rospy.Time.from_sec(robot.now)), OTHER
    ),
    "move_base by id": lambda robot: robot.node._on_move_base_cancel(
        GoalID(id="the stretch"), OTHER
    ),
    "another goal for move_base": lambda robot: robot.node._on_move_base_goal(
        MoveBaseActionGoal(), OTHER
    ),
    "move_base's result": lambda robot: robot.node._on_stretch_end(1, Outcome.CANCELLED, ""),
}


@pytest.mark.parametrize("connected", [True, False], ids=["", "without tf"])
@pytest.mark.parametrize("stop", STOPS.values(), ids=STOPS.keys())
def test_every_way_to_stop_acts_in_the_next_step_and_is_kept(
    robot: Robot, stop: Any, connected: bool
) -> None:
    robot.drive()
    robot.connected = connected
    sent = len(robot.sent)
    stop(robot)
    robot.step()
    assert robot.ends == [Outcome.CANCELLED]
    assert robot.kept
    robot.cancelled = ""
    robot.connected = True
    for _ in range(150):
        robot.step()
    assert len(robot.sent) == sent
    assert robot.kept


@pytest.mark.parametrize(
    "stop", [stop for name, stop in STOPS.items() if "another goal" not in name and "result" not in name]
)  # fmt: skip
def test_a_stop_cancels_the_goal_of_move_base(robot: Robot, stop: Any) -> None:
    robot.drive()
    stop(robot)
    robot.step()
    assert robot.cancels == 1


def test_a_cancel_is_not_waited_for_until_the_next_report_is_due(robot: Robot) -> None:
    robot.drive()
    robot.node._on_cancel(GoalID(), OTHER)
    assert robot.node._wake.is_set()
    robot.step(0.01)
    assert robot.ends == [Outcome.CANCELLED]


def test_what_the_coordinator_itself_asks_of_move_base_stops_nothing(robot: Robot) -> None:
    robot.node._on_move_base_cancel(GoalID(), NAME)
    robot.node._on_move_base_goal(MoveBaseActionGoal(), NAME)
    assert robot.events() == []


def test_a_cancel_from_the_future_stops_nothing(robot: Robot) -> None:
    """move_base drops it, too: it would block all goals until then."""
    robot.node._on_cancel(GoalID(stamp=rospy.Time.from_sec(START + 60.0)), OTHER)
    assert robot.events() == []


def test_events_are_in_the_order_of_their_arrival(robot: Robot) -> None:
    """A stop that arrives after a goal counts for that goal."""
    robot.target = PoseStamped()
    robot.node._events.put(_GoalArrived())
    robot.node._on_cancel(GoalID(), OTHER)
    robot.node._on_move_base_goal(MoveBaseActionGoal(), OTHER)
    kinds = [type(event).__name__ for event in robot.events()]
    assert kinds == ["NewGoal", CancelRequested.__name__, MoveBaseTaken.__name__]


@pytest.mark.parametrize("back", [0.5, 500.0])
def test_in_lockstep_a_clock_that_jumps_back_does_not_silence_the_coordinator(
    robot: Robot, back: float
) -> None:
    """It used to send no report until the clock had come as far again."""
    robot.drive()
    before = len(robot.reports)
    robot.step(-back)
    assert robot.forgotten == 1
    assert len(robot.reports) == before + 1
    for _ in range(4):
        robot.step()
    assert len(robot.reports) >= before + 2


def server_of(clients: set[str], *, preempted: bool = False) -> GoalServer:
    """Returns the action server of a goal of ``/client``, without a master."""
    server = GoalServer.__new__(GoalServer)
    server._server = SimpleNamespace(  # type: ignore[assignment]
        is_active=lambda: True,
        is_new_goal_available=lambda: False,
        is_preempt_requested=lambda: preempted,
    )
    server._handle = SimpleNamespace(lockstep=None)  # type: ignore[assignment]
    server._goals = SimpleNamespace(hears=clients.__contains__)  # type: ignore[assignment]
    server._client = "/client"
    return server


def test_a_goal_whose_client_has_ended_is_cancelled() -> None:
    assert server_of({"/client"}).cancelled() == ""
    assert "/client" in server_of({"/another"}).cancelled()
    assert server_of({"/client"}, preempted=True).cancelled() == "the goal was cancelled"


def test_taking_a_goal_waits_for_no_transform(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second in the loop would delay stops; the goal's frame was known when the goal arrived."""
    patience = []

    def wait(*arguments: Any) -> Transform:
        patience.append(arguments[-1])
        raise DisconnectedError("no transform")

    monkeypatch.setattr(rospy, "logerr", lambda *_: None)
    goal = MoveBaseGoal()
    goal.target_pose.header.frame_id = "odom"
    goal.target_pose.pose.orientation.w = 1.0
    aborted = []
    server = GoalServer.__new__(GoalServer)
    server._senders = []  # type: ignore[assignment]
    server._listener = SimpleNamespace(wait=wait)  # type: ignore[assignment]
    server._server = SimpleNamespace(  # type: ignore[assignment]
        is_new_goal_available=lambda: True,
        accept_new_goal=lambda: goal,
        set_aborted=lambda _, text: aborted.append(text),
    )
    assert server.take() is None
    assert patience == [0.0]
    assert aborted == ["no transform"]
