"""A robot's pilot: stops are never undone, every goal ends, and move_base gets goals only for a reason."""

import math
import random
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pioneer_traffic.config import PilotConfig
from pioneer_traffic.event import (
    Action,
    CancelDrive,
    CancelRequested,
    Condition,
    Drive,
    Event,
    Finish,
    GoalCancelled,
    Heard,
    Inputs,
    MoveBaseTaken,
    NewGoal,
    NewRoadmap,
    Note,
    Send,
    Status,
    StretchEnded,
)
from pioneer_traffic.geometry import Point
from pioneer_traffic.pilot import Pilot
from pioneer_traffic.report import NO_PLAN, Report
from pioneer_traffic.roadmap import Roadmap
from simple_navigation_goals.queue import Outcome


def row(places: int) -> Roadmap:
    """Returns a roadmap of places in a row, 1 m apart."""
    near = [
        [other for other in (place - 1, place + 1) if 0 <= other < places]
        for place in range(places)
    ]
    return Roadmap([(float(place), 0.0) for place in range(places)], near)


ROW, SHORT_ROW = row(9), row(7)
PERIOD = 0.2


@dataclass
class Robot:
    """A pilot with a move_base that drives at 1 m/s to what it is sent."""

    config: PilotConfig = field(default_factory=PilotConfig)
    position: Point | None = (0.0, 0.0)
    now: float = 10_000.0
    present: bool = True
    goes: bool = True  #: whether move_base drives
    stop: Drive | None = None  #: what move_base drives to
    drives: list[Drive] = field(default_factory=list)
    finished: list[Finish] = field(default_factory=list)
    reports: list[Report] = field(default_factory=list)
    waiting: list[Event] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.pilot = Pilot("a", self.config)

    def step(self, *events: Event) -> list[Action]:
        """Runs one period."""
        self.now += PERIOD
        arrived = [*self.waiting, *events]
        self.waiting = []
        actions = self.pilot.step(arrived, Inputs(self.position, self.now, self.present), self.now)
        for action in actions:
            match action:
                case Drive():
                    self.stop = action
                    self.drives.append(action)
                case CancelDrive():
                    self.stop = None
                case Finish():
                    self.finished.append(action)
                case Send(report):
                    self.reports.append(report)
                case Note():
                    pass
        self._move()
        return actions

    def run(self, seconds: float) -> None:
        """Runs for a while."""
        for _ in range(round(seconds / PERIOD)):
            self.step()

    def end_stretch(self, outcome: Outcome, text: str = "") -> None:
        """Lets move_base end its goal."""
        assert self.stop is not None
        self.waiting.append(StretchEnded(self.stop.number, outcome, text))
        self.stop = None

    def _move(self) -> None:
        if self.stop is None or self.position is None or not (self.goes and self.present):
            return
        left = math.dist(self.position, self.stop.stop)
        share = min(1.0, PERIOD / left) if left else 1.0
        x, y = self.position
        self.position = (x + share * (self.stop.stop[0] - x), y + share * (self.stop.stop[1] - y))
        if share == 1.0:
            self.end_stretch(Outcome.REACHED)


def driving_robot(**changes: object) -> Robot:
    """Returns a robot on its way to the row's end, not far from the start."""
    robot = Robot(**changes)  # type: ignore[arg-type]
    robot.step(NewRoadmap(ROW), NewGoal((8.0, 0.0)))
    robot.run(4.0)
    assert robot.stop is not None
    return robot


def test_a_goal_is_reached_stretch_by_stretch() -> None:
    robot = driving_robot()
    robot.run(20.0)
    assert [finish.outcome for finish in robot.finished] == [Outcome.REACHED]
    assert robot.drives[-1].final
    assert robot.position == (8.0, 0.0)


def test_a_goal_beside_a_place_is_reached_from_its_far_side() -> None:
    """The robot stopped within move_base's tolerance of the goal, too far from the place: it waited for ever."""
    robot = Robot()
    robot.step(NewRoadmap(ROW), NewGoal((6.13, 0.0)))
    while robot.stop is None or not robot.stop.final or robot.position < (5.5, 0.0):
        robot.step()
    robot.goes = False
    robot.position = (6.37, 0.0)
    robot.end_stretch(Outcome.REACHED)
    robot.run(10.0)
    assert [finish.outcome for finish in robot.finished] == [Outcome.REACHED]


STOPS = {
    "the goal by its client": GoalCancelled("the goal was cancelled"),
    "all goals": CancelRequested(everything=True),
    "move_base's by id": CancelRequested(number=1),
    "by stamp": CancelRequested(stamp=20_000.0),
    "another client of move_base": MoveBaseTaken("/rviz"),
}


def test_a_robot_that_loses_its_position_drives_no_farther_than_to_what_it_holds() -> None:
    """Beyond that, it may head only while the others hear where it is."""
    robot = driving_robot()
    assert robot.stop is not None
    assert robot.stop.stop[0] > robot.reports[-1].held[-1]
    robot.position = None
    robot.run(5.0)
    assert robot.stop is not None
    assert robot.stop.stop[0] <= robot.reports[-1].held[-1]


def test_a_robot_that_stands_sends_few_reports_and_what_is_new_at_once() -> None:
    """With 15 robots, 1,000 reports a second crossed the gateways."""
    robot = Robot()
    robot.step(NewRoadmap(ROW))
    robot.run(20.0)
    sent = len(robot.reports)
    robot.run(6.0)
    assert 6.0 / PilotConfig().lease * 3 <= len(robot.reports) - sent <= 11
    before = robot.reports[-1]
    robot.step(NewGoal((7.0, 0.0)))
    assert robot.reports[-1].goal != before.goal


def test_the_next_goal_does_not_begin_with_a_way_back_to_a_place() -> None:
    robot = Robot()
    robot.step(NewRoadmap(ROW), NewGoal((3.0, 0.25)))
    robot.run(30.0)
    assert robot.finished == [Finish(Outcome.REACHED, "Goal reached.")]
    before = len(robot.drives)
    robot.step(NewGoal((7.0, 0.0)))
    robot.run(30.0)
    assert [finish.outcome for finish in robot.finished] == [Outcome.REACHED] * 2
    assert all(drive.stop[0] > 4.0 for drive in robot.drives[before:])


@pytest.mark.parametrize("stop", STOPS.values(), ids=STOPS.keys())
def test_a_stop_ends_the_goal_at_once_and_the_robot_stays(stop: Event) -> None:
    """Cancelling move_base's goal used to be undone after 2 s; cancelling the goal left move_base driving."""
    robot = driving_robot()
    actions = robot.step(stop)
    assert [action.outcome for action in actions if isinstance(action, Finish)] == [
        Outcome.CANCELLED
    ]
    assert CancelDrive() in actions or isinstance(stop, MoveBaseTaken)
    drives = len(robot.drives)
    robot.run(60.0)
    assert len(robot.drives) == drives


def test_a_cancelled_goal_of_move_base_is_not_sent_again() -> None:
    robot = driving_robot()
    robot.end_stretch(Outcome.CANCELLED)
    drives = len(robot.drives)
    robot.run(60.0)
    assert len(robot.drives) == drives
    assert [finish.outcome for finish in robot.finished] == [Outcome.CANCELLED]


def test_a_stop_between_two_stretches_counts() -> None:
    """While the robot waits for others, move_base has no goal, so that only the request tells."""
    robot = driving_robot(goes=False)
    robot.stop = None
    robot.waiting.append(StretchEnded(robot.drives[-1].number, Outcome.LOST, ""))
    robot.step(CancelRequested(everything=True))
    robot.run(30.0)
    assert len(robot.drives) == 1


def test_a_stop_counts_without_a_position_and_without_a_map() -> None:
    robot = driving_robot()
    robot.position = None
    actions = robot.step(GoalCancelled("cancelled"))
    assert CancelDrive() in actions
    waiting = Robot()
    waiting.step(NewGoal((1.0, 0.0)), GoalCancelled("cancelled"))
    assert [finish.outcome for finish in waiting.finished] == [Outcome.CANCELLED]


def test_a_cancel_of_other_goals_does_not_stop_the_robot() -> None:
    robot = driving_robot()
    robot.step(CancelRequested(stamp=1.0))
    robot.run(20.0)
    assert [finish.outcome for finish in robot.finished] == [Outcome.REACHED]


def test_a_held_robot_takes_no_part_until_its_next_goal() -> None:
    robot = driving_robot()
    robot.step(CancelRequested(everything=True))
    robot.run(1.0)
    assert robot.reports[-1].held == ()
    assert robot.reports[-1].goal == -1
    robot.step(NewGoal((8.0, 0.0)))
    robot.run(30.0)
    assert robot.finished[-1].outcome is Outcome.REACHED


def test_a_pilot_that_starts_held_takes_no_part_until_its_first_goal() -> None:
    """The pilot before it, which was killed, had been stopped."""
    robot = Robot()
    robot.pilot = Pilot("a", robot.config, held="cancelled by /rviz")
    robot.step(NewRoadmap(ROW))
    robot.run(1.0)
    assert robot.reports[-1].held == ()
    assert (
        robot.pilot.status.text() == "held: cancelled by /rviz: the robot stays until the next goal"
    )
    robot.step(NewGoal((8.0, 0.0)))
    robot.run(30.0)
    assert robot.finished[-1].outcome is Outcome.REACHED


def test_a_new_map_keeps_the_goal() -> None:
    """The goal used to stay active for ever, and the robot stood."""
    robot = driving_robot()
    robot.step(NewRoadmap(SHORT_ROW), NewGoal((6.0, 0.0)))
    robot.run(5.0)
    robot.step(NewRoadmap(ROW))
    robot.run(30.0)
    assert [finish.outcome for finish in robot.finished] == [Outcome.REACHED]


def test_a_goal_away_from_a_new_map_is_aborted() -> None:
    robot = driving_robot()
    robot.step(NewRoadmap(row(3)))
    robot.run(1.0)
    assert [finish.outcome for finish in robot.finished] == [Outcome.ABORTED]


@pytest.mark.parametrize("point", [(math.nan, 0.0), (0.0, math.inf), (50.0, 50.0)])
def test_a_goal_that_is_no_place_is_aborted(point: Point) -> None:
    robot = Robot()
    robot.step(NewRoadmap(ROW), NewGoal(point))
    assert [finish.outcome for finish in robot.finished] == [Outcome.ABORTED]


def test_a_way_that_move_base_gives_up_again_and_again_ends_the_goal() -> None:
    robot = driving_robot(goes=False)
    for _ in range(200):
        if robot.stop is not None:
            robot.end_stretch(Outcome.ABORTED, "blocked")
        robot.step()
    assert len(robot.drives) == 1 + robot.config.retries
    assert [finish.outcome for finish in robot.finished] == [Outcome.ABORTED]
    assert "blocked" in robot.finished[0].text


@pytest.mark.parametrize("missing", ["map", "position", "move_base"])
def test_a_goal_that_cannot_begin_ends_with_the_reason(missing: str) -> None:
    robot = Robot(
        position=None if missing == "position" else (0.0, 0.0), present=missing != "move_base"
    )
    robot.step(*(() if missing == "map" else (NewRoadmap(ROW),)), NewGoal((8.0, 0.0)))
    robot.run(robot.config.stall + 5.0)
    assert [finish.outcome for finish in robot.finished] == [Outcome.ABORTED]
    assert missing in robot.finished[0].text


def test_a_goal_behind_a_robot_that_stays_ends_with_its_name() -> None:
    robot = driving_robot()
    for _ in range(round(120.0 / PERIOD)):
        robot.step(Heard(Report("b", ROW.signature, (7.0, 0.0))))
    assert [finish.outcome for finish in robot.finished] == [Outcome.ABORTED]
    assert "b" in robot.finished[0].text


def test_a_robot_whose_partner_falls_silent_stands_before_it_and_names_it() -> None:
    """What a silent robot held stays its own: after the lease, it is an obstacle where it was last."""
    robot = driving_robot()
    partner = Report("b", ROW.signature, (6.0, 0.0), (6,), heard=("a",), ready=NO_PLAN)
    for _ in range(5):
        robot.step(Heard(partner))
    robot.run(20.0)
    assert robot.position is not None
    assert robot.position[0] <= 5.0 + robot.config.reach
    assert robot.pilot.status.condition is Condition.WAITING
    assert robot.pilot.status.robots == ("b",)
    assert "b (sends no reports)" in robot.pilot.status.text()


def test_a_robot_that_does_not_know_where_it_is_takes_no_further_place() -> None:
    robot = driving_robot()
    robot.position = None
    drives = len(robot.drives)
    robot.end_stretch(Outcome.ABORTED, "a transform is missing")
    robot.run(20.0)
    assert len(robot.drives) == drives
    assert robot.pilot.status.text() == "blocked: the robot's position in map is unknown"


def test_the_status_says_what_the_robot_does() -> None:
    robot = Robot()
    assert robot.pilot.status == Status(Condition.IDLE)
    robot.step(NewGoal((8.0, 0.0)))
    assert robot.pilot.status.text() == "starting: no map has arrived"
    robot.step(NewRoadmap(ROW))
    robot.run(4.0)
    assert robot.pilot.status == Status(Condition.DRIVING)
    robot.step(CancelRequested(everything=True, reason="cancelled by /rviz"))
    held = "held: cancelled by /rviz: the robot stays until the next goal"
    assert robot.pilot.status.text() == held
    robot.step(NewGoal((50.0, 50.0)))
    assert robot.pilot.status.condition is Condition.HELD
    robot.step(NewGoal((3.0, 0.0)))
    robot.run(20.0)
    assert robot.pilot.status == Status(Condition.IDLE)


def test_an_idle_robot_that_is_moved_by_hand_stays() -> None:
    robot = Robot()
    robot.step(NewRoadmap(ROW))
    robot.run(4.0)
    robot.position = (1.0, 0.0)
    robot.run(1.0)
    assert robot.pilot.held


def test_an_idle_robot_alone_does_not_drive_to_a_place() -> None:
    robot = Robot(position=(0.4, 0.0))
    robot.step(NewRoadmap(ROW))
    robot.run(10.0)
    assert not robot.drives


def test_a_clock_that_jumps_back_delays_nothing() -> None:
    robot = driving_robot()
    robot.now = 9_000.0
    robot.run(30.0)
    assert [finish.outcome for finish in robot.finished] == [Outcome.REACHED]


@dataclass
class Chaos:
    """Random events for one robot, and what must hold after each step. At most one goal or stop a step."""

    seed: int

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        self.robot = Robot()
        self.active = False  # whether a goal is active
        self.stopped = False  # by a stop that no later goal has ended
        self.first = 1  # number of the first stretch of the active goal

    def run(self, steps: int) -> None:
        """Runs for ``steps`` periods with random events, then without until the active goal has ended."""
        for _ in range(steps):
            self.change_surroundings()
            others = self.others()
            self.step(self.control(), others)
        deadline = self.robot.now + self.robot.config.limit + 10.0
        while self.active and self.robot.now < deadline:
            self.step(None, [])
        assert not self.active, f"seed {self.seed}: a goal did not end"

    def change_surroundings(self) -> None:
        """Changes clock, position, and what move_base does."""
        chance = self.random.random
        robot = self.robot
        if chance() < 0.01:
            robot.now += self.random.choice([-50.0, -0.5, 0.5, 30.0])
        if chance() < 0.02:
            robot.position = self.random.choice(
                [None, (self.random.uniform(0.0, 8.0), self.random.uniform(-0.3, 0.3))]
            )
        if chance() < 0.03:
            robot.present = not robot.present
            if not robot.present:
                robot.stop = None
        if chance() < 0.05:
            robot.goes = not robot.goes

    def others(self) -> list[Event]:
        """Returns random maps, reports and failures of move_base."""
        chance = self.random.random
        robot = self.robot
        events: list[Event] = []
        if chance() < 0.02:
            events.append(NewRoadmap(self.random.choice([ROW, SHORT_ROW])))
        if chance() < 0.3:
            place = self.random.randrange(7)
            held = self.random.choice([(), (place,)])
            signature = self.random.choice([ROW.signature, SHORT_ROW.signature, 7])
            goal = self.random.choice([-1, 0, 6])
            report = Report("b", signature, (float(place), 0.0), held, goal, heard=("a",))
            events.append(Heard(report))
        if robot.stop is not None and chance() < 0.05:
            robot.end_stretch(
                self.random.choice([Outcome.ABORTED, Outcome.LOST, Outcome.REACHED]), "given up"
            )
        return events

    def control(self) -> Event | None:
        """Returns a goal, a stop or nothing."""
        if self.random.random() < 0.03:
            return NewGoal((self.random.choice([-5.0, 0.2, 3.0, 5.5, 8.0, math.nan]), 0.0))
        if self.random.random() > 0.02:
            return None
        robot = self.robot
        if robot.stop is not None and self.random.random() < 0.3:
            return StretchEnded(robot.stop.number, Outcome.CANCELLED, "cancelled")
        return self.random.choice(
            [
                GoalCancelled("cancelled"),
                CancelRequested(everything=True),
                CancelRequested(number=robot.drives[-1].number if robot.drives else 1),
                CancelRequested(stamp=robot.now + 1.0),
                MoveBaseTaken("/rviz"),
            ]
        )

    def is_stop(self, control: Event | None) -> bool:
        """Returns whether a control event has to stop the robot."""
        match control:
            case GoalCancelled():
                return self.active
            case CancelRequested(number=number) if number > 0:
                return number <= len(self.robot.drives) and (
                    not self.active or number >= self.first
                )
            case CancelRequested() | MoveBaseTaken() | StretchEnded():
                return True
        return False

    def step(self, control: Event | None, others: list[Event]) -> None:
        """Runs one period and checks its actions."""
        robot = self.robot
        place = f"seed {self.seed}, {robot.now:.1f} s"
        stops = self.is_stop(control)
        if isinstance(control, MoveBaseTaken | StretchEnded):
            robot.stop = None  # move_base has ended or replaced it
        if isinstance(control, NewGoal):
            self.active = True
            self.first = len(robot.drives) + 1
        # The control event comes last: reports and failures of the same period must not hide it.
        actions = robot.step(*others, *([] if control is None else [control]))
        ended = [action for action in actions if isinstance(action, Finish)]
        drives = [action for action in actions if isinstance(action, Drive)]
        assert len(ended) <= 1 + isinstance(control, NewGoal), place
        if stops:
            assert not self.active or ended, f"{place}: a stop left the goal active"
            self.stopped = True
        if ended:
            self.active = robot.pilot.has_goal
        if isinstance(control, NewGoal) and not robot.pilot.held:
            self.stopped = False  # it was accepted, though perhaps it has ended already
        assert self.active == robot.pilot.has_goal, f"{place}: a goal ended without a result"
        self.check_status(place)
        assert not (self.stopped and drives), f"{place}: a stop was undone"
        assert not (self.stopped and robot.stop), f"{place}: the robot drives after a stop"
        if drives and not self.active:
            assert robot.reports[-1].adopted.number > 0, (
                f"{place}: the robot drives without goal and plan"
            )

    def check_status(self, place: str) -> None:
        """Checks that the status gives the true reason of a robot that stands."""
        status = self.robot.pilot.status
        stands = (Condition.STARTING, Condition.BLOCKED, Condition.WAITING)
        if self.active:
            assert status.condition in (Condition.DRIVING, *stands), f"{place}: {status}"
        else:
            assert status.condition not in (Condition.DRIVING, *stands), f"{place}: {status}"
        is_held = bool(self.robot.pilot.held) and not self.active
        assert (status.condition is Condition.HELD) == is_held, f"{place}: {status}"
        if status.condition not in (Condition.DRIVING, Condition.IDLE):
            assert status.reason, f"{place}: no reason"


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**9))
def test_no_stop_is_undone_and_every_goal_ends_whatever_happens(seed: int) -> None:
    Chaos(seed).run(300)
