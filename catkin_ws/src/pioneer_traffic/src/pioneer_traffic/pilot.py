"""One robot's pilot: joins its goal, its part in the right of way, and the goals that it sends to move_base.

``Pilot.step`` takes what has happened since the last step and returns what to do. The pilot sends move_base to the end
of the stretch that the robot may drive, again and again, until the goal is reached.

A stop is never undone: any node that cancels the goal, or move_base's, stops the robot, which then stays until the
next goal and is an obstacle for the others. Every goal ends: reached, stopped, or aborted with the reason.

No ROS, no clock: the caller passes the time [s].
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from pioneer_traffic.config import PilotConfig
from pioneer_traffic.coordinator import Coordinator
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
from pioneer_traffic.report import Report
from pioneer_traffic.roadmap import Roadmap
from simple_navigation_goals.queue import Outcome

_SAME = 0.05
"""Distance below which a stop counts as the one that move_base already has [m]."""
_RETRY = 2.0
"""Delay before a stop that move_base gave up is sent again [s]; for a robot without a goal, it doubles each time."""
_DOUBLINGS = 4
_BEAT = 0.6
"""Longest time between two reports [s]: several in a lease. Only what is new for the others is sent sooner."""
_BEAT_SLACK = 0.05
"""Part of that by which a step may come too early [s]."""
_NEW_POSITION = 0.25
"""Distance by which a robot must move for its position to be new for the others [m]."""
_MOVED = 0.5
"""Distance by which a robot must move for its movement to count as progress, or as being carried [m]."""


@dataclass
class _Goal:
    point: Point
    since: float  # ROS time [s]
    begin: float
    first: int  # number of its first stretch


@dataclass
class _Stretch:
    number: int
    stop: Point
    final: bool
    onward: bool  #: whether it leads beyond the places that the robot holds
    active: bool = True
    reached: bool = False
    retry_at: float = math.inf


class _Progress:
    """Since when none of a set of robots has moved."""

    def __init__(self) -> None:
        self._last: dict[str, Point] = {}
        self.since = math.inf

    def update(self, positions: dict[str, Point], now: float) -> float:
        """Returns for how long no robot has moved; a robot that comes or goes counts as moved."""
        moved = positions.keys() != self._last.keys() or any(
            math.dist(point, self._last[name]) > _MOVED for name, point in positions.items()
        )
        if moved:
            self.restart(now)
            self._last = dict(positions)
        return now - self.since

    def restart(self, now: float) -> None:
        """Counts as a movement of all."""
        self.since = now


class Pilot:
    """Drives one robot to its goals.

    Args:
        name: of the robot.
        config: the same for all robots.
        expected: names of the other robots, as far as known.
        held: why the robot stays until its first goal; empty if it does not.
    """

    def __init__(
        self, name: str, config: PilotConfig, expected: Iterable[str] = (), held: str = ""
    ) -> None:
        self._name = name
        self._config = config
        self._expected = tuple(expected)
        self._coordinator: Coordinator | None = None
        self._goal: _Goal | None = None
        self._stretch: _Stretch | None = None
        self._stretches = 0
        self._failures = 0
        self._progress = _Progress()
        self._stood_at: Point | None = None  # where the robot came to stand without a goal
        self._stepped_at = -math.inf
        self._actions: list[Action] = []
        self._failure = ""  # why the last goal was aborted
        self._inputs: Inputs | None = None  # of the last step
        self._sent: Report | None = None  # the last report
        self._sent_at = -math.inf
        self.held = held  #: why the robot stays until the next goal; empty if it does not

    @property
    def has_goal(self) -> bool:
        """Whether a goal is active."""
        return self._goal is not None

    @property
    def status(self) -> Status:
        """What the robot does after the last step, and why it does not get on."""
        if self._goal is not None and self._inputs is not None:
            is_driving = self._stretch is not None and self._stretch.active
            return Status(Condition.DRIVING) if is_driving else self._obstruction(self._inputs)
        if self.held:
            return Status(Condition.HELD, f"{self.held}: the robot stays until the next goal")
        if self._failure:
            return Status(Condition.FAILED, self._failure)
        return Status()

    def step(self, events: Sequence[Event], inputs: Inputs, now: float) -> list[Action]:
        """Returns what to do after ``events``, which are in the order of their arrival."""
        self._actions = []
        if now < self._stepped_at:
            self._restart_clock(inputs, now)
        self._stepped_at = now
        for event in events:
            self._take(event, inputs, now)
        self._watch_move_base(inputs)
        self._coordinate(inputs, now)
        self._watch_hands(inputs)
        self._drive(inputs, now)
        self._watch_goal(inputs, now)
        self._inputs = inputs
        return self._actions

    def _restart_clock(self, inputs: Inputs, now: float) -> None:
        """Counts all times from now on, because the clock jumped back."""
        self._progress.restart(now)
        if self._goal is not None:
            self._goal.begin = now
            self._goal.since = min(self._goal.since, inputs.stamp)
        if self._stretch is not None:
            self._stretch.retry_at = min(self._stretch.retry_at, now + _RETRY)

    def _take(self, event: Event, inputs: Inputs, now: float) -> None:
        match event:
            case NewGoal():
                self._begin(event, inputs, now)
            case GoalCancelled(reason):
                if self._goal is not None:
                    self._stop(reason)
            case CancelRequested():
                if self._concerns(event, inputs):
                    self._stop(event.reason)
            case MoveBaseTaken(node):
                self._stretch = (
                    None  # it is not to be cancelled: the other node's goal has replaced it
                )
                self._stop(f"{node} sent move_base a goal")
            case StretchEnded():
                self._end_stretch(event, inputs, now)
            case NewRoadmap(roadmap):
                self._use_roadmap(roadmap, inputs)
            case Heard(report):
                if self._coordinator is not None:
                    self._coordinator.receive(report, now)

    def _begin(self, event: NewGoal, inputs: Inputs, now: float) -> None:
        """Starts a goal; the caller has ended the one before."""
        self._goal = _Goal(event.point, inputs.stamp, now, self._stretches + 1)
        self._failures = 0
        self._failure = ""
        self._progress.restart(now)
        if self._stretch is not None and self._stretch.final:
            self._stretch.final = False  # it was the goal before
        if event.fault or not all(map(math.isfinite, event.point)):
            self._abort(event.fault or "the goal's position is not finite")
            return
        if self._set_waypoint(inputs):
            self.held = ""

    def _set_waypoint(self, inputs: Inputs) -> bool:
        """Gives the coordinator the goal, if both are there; aborts the goal and returns False if it is refused."""
        goal = self._goal
        if goal is None or self._coordinator is None:
            return True
        if self._coordinator.set_waypoint(goal.point, min(goal.since, inputs.stamp)):
            return True
        self._abort(
            f"({goal.point[0]:.2f}, {goal.point[1]:.2f}) is in a wall, or no place of the roadmap is near"
        )
        return False

    def _use_roadmap(self, roadmap: Roadmap, inputs: Inputs) -> None:
        """Starts again on a new roadmap; the goal stays."""
        coordinator = self._coordinator
        if coordinator is not None and coordinator.report.roadmap == roadmap.signature:
            return
        self._coordinator = Coordinator(self._name, roadmap, self._config, self._expected)
        if self.held:
            self._coordinator.hold()
        self._set_waypoint(inputs)

    def _concerns(self, cancel: CancelRequested, inputs: Inputs) -> bool:
        """Returns whether a cancel request means what the robot does now, also between two stretches."""
        first = self._goal.first if self._goal is not None else self._stretches
        since = self._goal.since if self._goal is not None else 0.0
        if cancel.everything or 0 < first <= cancel.number:
            return True
        return cancel.stamp > 0.0 and since <= cancel.stamp

    def _stop(self, reason: str) -> None:
        """Stops the robot, which then stays until the next goal."""
        if not self.held:
            self._actions.append(Note(f"{reason}: the robot stays until the next goal"))
        self.held = reason
        self._end_goal(Outcome.CANCELLED, reason)
        self._cancel_stretch()
        if self._coordinator is not None:
            self._coordinator.hold()

    def _abort(self, reason: str) -> None:
        self._failure = reason
        self._cancel_stretch()
        self._end_goal(Outcome.ABORTED, reason)

    def _end_goal(self, outcome: Outcome, text: str) -> None:
        if self._goal is None:
            return
        self._goal = None
        self._actions.append(Finish(outcome, text))
        if self._coordinator is not None:
            self._coordinator.set_waypoint(None, 0.0)

    def _cancel_stretch(self) -> None:
        if self._stretch is not None and self._stretch.active:
            self._actions.append(CancelDrive())
        self._stretch = None

    def _end_stretch(self, event: StretchEnded, inputs: Inputs, now: float) -> None:
        stretch = self._stretch
        if stretch is None or not stretch.active or stretch.number != event.number:
            return
        stretch.active = False
        if event.outcome is Outcome.CANCELLED:
            self._stop(event.text or "the goal of move_base was cancelled")
        elif event.outcome is Outcome.LOST:
            self._stretch = None
        elif event.outcome is Outcome.REACHED and self._is_at(stretch.stop, inputs):
            stretch.reached = True
            self._failures = 0
        else:
            self._fail(stretch, event, now)

    def _fail(self, stretch: _Stretch, event: StretchEnded, now: float) -> None:
        self._failures += 1
        place = f"({stretch.stop[0]:.2f}, {stretch.stop[1]:.2f})"
        short = event.outcome is Outcome.REACHED
        reason = (
            f"ended its way to {place} elsewhere"
            if short
            else f"gave up the way to {place}: {event.text}"
        )
        if self._goal is not None and self._failures > self._config.retries:
            self._abort(f"move_base {reason}")
            return
        doublings = 0 if self._goal is not None else min(self._failures - 1, _DOUBLINGS)
        stretch.retry_at = now + _RETRY * 2.0**doublings
        self._actions.append(Note(f"move_base {reason}"))

    def _watch_move_base(self, inputs: Inputs) -> None:
        """Forgets the stretch when move_base is gone: it will not know it when it is back."""
        if not inputs.present:
            self._stretch = None

    def _coordinate(self, inputs: Inputs, now: float) -> None:
        coordinator = self._coordinator
        if coordinator is None or inputs.position is None:
            return
        coordinator.set_obstacles(inputs.obstacles)
        self._send(coordinator.advance(inputs.position, now), now)
        stretch = self._stretch
        if coordinator.finished and stretch is not None and stretch.final and stretch.reached:
            self._end_goal(Outcome.REACHED, "Goal reached.")

    def _send(self, report: Report, now: float) -> None:
        """Sends a report with something new, or if the last one was sent long ago.

        A few centimetres are not new, unless the robot holds no places: then it is an obstacle where it is.
        """
        sent = self._sent
        is_new = (
            sent is None
            or not report.held
            or math.dist(report.position, sent.position) > _NEW_POSITION
            or replace(report, position=sent.position) != sent
        )
        if is_new or not 0.0 <= now - self._sent_at < _BEAT - _BEAT_SLACK:
            self._sent = report
            self._sent_at = now
            self._actions.append(Send(report))

    def _watch_hands(self, inputs: Inputs) -> None:
        """Holds a robot that is moved while it has no goal: it is carried, or driven by hand."""
        is_driving = self._stretch is not None and self._stretch.active
        if self._goal is not None or is_driving or self.held or inputs.position is None:
            self._stood_at = None
        elif self._stood_at is None:
            self._stood_at = inputs.position
        elif math.dist(self._stood_at, inputs.position) > _MOVED:
            self._stop("moved by hand")

    def _drive(self, inputs: Inputs, now: float) -> None:
        """Sends move_base to the end of the route, if that has changed."""
        coordinator = self._coordinator
        position = inputs.position
        if self.held or coordinator is None or not inputs.present:
            return
        if position is None:
            # Nobody sees any more how far the robot has come beyond what it holds.
            coordinator.onward = None
            position = coordinator.report.position
            if self._stretch is None or not (self._stretch.active and self._stretch.onward):
                return
        route = coordinator.route
        if not route:
            self._cancel_stretch()
            return
        if self._goal is None and not coordinator.makes_way:
            return
        if coordinator.onward is not None:
            route = [*route, coordinator.onward]
        stop, final = self._stop_of(route)
        if self._has_stop(stop, final, position, now):
            return
        stands = self._stretch is None or self._stretch.reached
        if stands and not final and len(route) == 1 and self._is_at(stop, inputs):
            return
        self._stretches += 1
        self._stretch = _Stretch(self._stretches, stop, final, coordinator.onward is not None)
        before = route[-2] if len(route) > 1 else position
        self._actions.append(Drive(self._stretches, stop, before, final))

    def _stop_of(self, route: Sequence[Point]) -> tuple[Point, bool]:
        """Returns where the route ends, and whether that is the goal."""
        end = route[-1]
        if self._goal is not None and math.dist(end, self._goal.point) <= 0.5 * self._config.reach:
            return self._goal.point, True
        return end, False

    def _has_stop(self, stop: Point, final: bool, position: Point, now: float) -> bool:
        """Returns whether move_base has this stop, has driven to it, or gave it up a moment ago."""
        stretch = self._stretch
        if (
            stretch is None
            or math.dist(stop, stretch.stop) >= _SAME
            or (final and not stretch.final)
        ):
            return False
        is_there = stretch.reached and math.dist(position, stop) <= self._config.stray
        return stretch.active or is_there or (not stretch.reached and now < stretch.retry_at)

    def _watch_goal(self, inputs: Inputs, now: float) -> None:
        """Aborts a goal that takes too long, or that waits while nobody moves."""
        goal = self._goal
        if goal is None:
            return
        if now - goal.begin > self._config.limit:
            self._abort(f"not reached within {self._config.limit:g} s")
            return
        if self._stretch is not None and self._stretch.active and inputs.position is not None:
            self._progress.restart(now)  # move_base has bounds of its own
        positions: dict[str, Point] = {}
        if inputs.position is not None:
            positions[self._name] = inputs.position
        if self._coordinator is not None:
            positions |= self._coordinator.partners()
        if self._progress.update(positions, now) > self._config.stall:
            reason = self._obstruction(inputs).reason
            self._abort(f"{reason}; no robot has moved for {self._config.stall:g} s")

    def _obstruction(self, inputs: Inputs) -> Status:
        """Returns what the goal waits for."""
        if inputs.position is None:
            return Status(Condition.BLOCKED, "the robot's position in map is unknown")
        if self._coordinator is None:
            return Status(Condition.STARTING, "no map has arrived")
        if not inputs.present:
            return Status(Condition.BLOCKED, "move_base is not running")
        if self._failures:
            return Status(Condition.BLOCKED, "move_base has given up the way")
        text, robots = self._coordinator.obstruction()
        return Status(Condition.WAITING, text, robots)

    def _is_at(self, point: Point, inputs: Inputs) -> bool:
        return (
            inputs.position is not None and math.dist(inputs.position, point) <= self._config.reach
        )
