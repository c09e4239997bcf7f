"""move_base's logic as a pure state machine.

``advance`` takes the state, the inputs since the last cycle and the time. It returns the next state, the velocity
to command (None: command nothing) and the events that the node has to carry out. Plans, costmaps and goals stay in
the node; the state machine sees only their outcomes.
"""

import math
from dataclasses import dataclass, field, replace
from enum import Enum

from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import STANDSTILL, Velocity
from nav_bundle.move_base.progress import Progress, ProgressLimits


class Phase(Enum):
    """State of move_base."""

    IDLE = "idle"
    PLANNING = "planning"
    CONTROLLING = "controlling"
    CLEARING = "clearing"


class Trigger(Enum):
    """Why recovery started; the value is Noetic's abort message when all recovery behaviours have failed."""

    PLANNING = "Failed to find a valid plan. Even after executing recovery behaviors."
    CONTROLLING = "Failed to find a valid control. Even after executing recovery behaviors."
    OSCILLATION = "Robot is oscillating. Even after executing recovery behaviors."
    PUSHING = (
        "Robot is commanded to drive and does not move. Even after executing recovery behaviors."
    )
    SENSORS = "Sensor data is out of date."
    PROGRESS = "Robot makes no progress towards the goal. Even after executing recovery behaviors."
    TIME = "The goal was not reached within its total time, goal_timeout_scale times that of its first plan."


class PlanOutcome(Enum):
    """Outcome of the search for a plan, if it has ended."""

    NONE = "none"
    FOUND = "found"
    FAILED = "failed"


class Outcome(Enum):
    """How a goal ended."""

    SUCCEEDED = "succeeded"
    ABORTED = "aborted"
    PREEMPTED = "preempted"


@dataclass(frozen=True)
class Limits:
    """Parameters of the state machine: times [s], frequencies [Hz], distances [m].

    ``max_planning_retries`` below 0 and ``oscillation_timeout`` 0 mean no limit.
    ``planner_frequency`` 0 means plan once per goal and whenever control fails. ``meeting_period`` is the longest time
    between plans while an unmapped obstacle is near or the plan is blocked.
    """

    planner_frequency: float = 0.0
    planner_patience: float = 5.0
    controller_patience: float = 15.0
    max_planning_retries: int = -1
    oscillation_timeout: float = 0.0
    oscillation_distance: float = 0.5
    meeting_period: float = 0.5
    recoveries: int = 0
    progress: ProgressLimits = field(default_factory=ProgressLimits)

    @property
    def planning_period(self) -> float:
        """Time between plans while the robot drives [s]; infinite if ``planner_frequency`` is 0."""
        return 1.0 / self.planner_frequency if self.planner_frequency > 0.0 else math.inf


@dataclass(frozen=True)
class State:
    """State of the machine between two cycles; times are ROS times [s]."""

    phase: Phase = Phase.IDLE
    plan_due: float = math.inf
    last_valid_plan: float = 0.0
    last_search: float = 0.0
    last_valid_control: float = 0.0
    planning_retries: int = 0
    last_oscillation_reset: float = 0.0
    oscillation_pose: Pose | None = None
    recovery_index: int = 0
    recovering: bool = False
    trigger: Trigger = Trigger.PLANNING
    recovery_begun: float = 0.0
    progress: Progress = field(default_factory=Progress)
    goal: int = 0  #: number of the active goal; 0 without one
    planned_goal: int = 0  #: number of the goal that the followed plan leads to; 0 without a plan

    @property
    def follows_earlier(self) -> bool:
        """Whether the plan that is followed leads to a goal that was replaced."""
        return self.phase is Phase.CONTROLLING and self.planned_goal != self.goal


@dataclass(frozen=True)
class Inputs:
    """Inputs since the last cycle."""

    new_goal: bool = False  #: a goal was accepted; it replaces the active one
    cancel: bool = False  #: the active goal was cancelled
    pose: Pose | None = None  #: the robot's pose in the global frame; None if unknown
    current: bool = True  #: sensor data, odometry and transforms are recent enough to drive
    plan: PlanOutcome = PlanOutcome.NONE  #: outcome of the search for a plan, if it has ended
    searched_goal: int | None = None  #: number of the goal of that search; None: the active one
    control: Velocity | None = (
        None  #: the local planner's command; None if it found no valid velocity
    )
    reached: bool = False  #: the local planner reports that the goal is reached
    recovery: Velocity | None = None  #: the active recovery behaviour's command
    recovered: bool = False  #: the active recovery behaviour has ended
    meeting: bool = False  #: an unmapped obstacle is near, so plans must be renewed sooner
    pushing: bool = False  #: the robot is commanded to drive but does not move
    remaining: float | None = (
        None  #: remaining way by the current plan [m]; None without a plan, or if it is blocked
    )
    blocked: bool = False  #: the current plan leads through an obstacle
    blocked_near: bool = False  #: the current plan leads through an obstacle that is near
    discovered: bool = False  #: an obstacle that was not known before was found on the way


@dataclass(frozen=True)
class StartPlanning:
    """Start a search for a plan to the active goal, unless an earlier search is still running."""


@dataclass(frozen=True)
class StopPlanning:
    """Abandon the current search for a plan."""


@dataclass(frozen=True)
class FollowPlan:
    """Pass the new plan to the local planner."""


@dataclass(frozen=True)
class StartRecovery:
    """Start the recovery behaviour with this index."""

    index: int
    trigger: Trigger


@dataclass(frozen=True)
class Finish:
    """End the goal; ``trigger`` is what made an aborted goal fail."""

    outcome: Outcome
    text: str
    trigger: Trigger | None = None


@dataclass(frozen=True)
class Warn:
    """Log a warning."""

    text: str


Event = StartPlanning | StopPlanning | FollowPlan | StartRecovery | Finish | Warn
Step = tuple[State, Velocity | None, tuple[Event, ...]]

RETRY_PERIOD = 0.1
"""Longest wait between two searches while the robot has no plan [s]."""
PUSHING_TEXT = "The robot is commanded to drive and does not move: it pushes against something, or its motors are off"
STALE_TEXT = (
    "Sensor data is out of date, we're not going to allow commanding of the base for safety"
)


def advance(state: State, inputs: Inputs, now: float, limits: Limits) -> Step:
    """Returns the next state, the velocity to command (None: leave the base alone) and the events of one cycle."""
    if inputs.new_goal:
        return _begin(state, inputs, now)
    if state.phase is Phase.IDLE:
        return state, None, ()
    if inputs.cancel:
        return _finish(Outcome.PREEMPTED, "")
    state = _watch_oscillation(state, inputs.pose, now, limits)
    state = _watch_progress(state, inputs, now, limits)
    if state.progress.is_late(now):
        return _finish(Outcome.ABORTED, Trigger.TIME.value, Trigger.TIME)
    if not inputs.current:
        return _wait_for_sensors(state, now, limits)
    if state.phase is not Phase.CLEARING and state.progress.stalls(now, limits.progress):
        return _clear(replace(state, recovery_index=state.progress.recoveries), Trigger.PROGRESS)
    if state.follows_earlier:
        # The local planner decided by the earlier plan.
        inputs = replace(inputs, reached=False)
    state, planned, events = _take_plan(state, inputs, now, limits)
    if planned is not None:
        return state, planned, events
    command: Velocity | None = None
    more: tuple[Event, ...] = ()
    if state.phase is Phase.CONTROLLING:
        state, command, more = _control(state, inputs, now, limits)
    elif state.phase is Phase.CLEARING:
        state, command, more = _recover(state, inputs, now, limits)
    if (
        (inputs.meeting or inputs.blocked)
        and state.phase is Phase.CONTROLLING
        and math.isfinite(state.plan_due)
    ):
        state = replace(
            state, plan_due=min(state.plan_due, state.last_search + limits.meeting_period)
        )
    state, request = _request_plan(state, now)
    return state, command, events + more + request


def _begin(state: State, inputs: Inputs, now: float) -> Step:
    """Starts a new goal.

    A robot that drives follows its earlier plan until there is one to the new goal, and a search that is running goes
    on: so goals that arrive faster than searches end do not stop the robot. Any other robot stands still.
    """
    drives = state.phase is Phase.CONTROLLING
    state = State(
        phase=Phase.CONTROLLING if drives else Phase.PLANNING,
        last_valid_plan=now,
        last_valid_control=now,
        last_oscillation_reset=now,
        oscillation_pose=inputs.pose,
        progress=Progress(since=now),
        goal=state.goal + 1,
        planned_goal=state.planned_goal if drives else 0,
    )
    return state, None if drives else STANDSTILL, (StartPlanning(),)


def _finish(outcome: Outcome, text: str, trigger: Trigger | None = None) -> Step:
    return State(), STANDSTILL, (StopPlanning(), Finish(outcome, text, trigger))


def _watch_progress(state: State, inputs: Inputs, now: float, limits: Limits) -> State:
    """Updates the progress by the remaining way; recovery behaviours and plans to earlier goals do not count."""
    if state.phase is Phase.CLEARING or state.follows_earlier:
        return state
    progress = state.progress
    if inputs.discovered:
        progress = progress.discovered(now)
    if inputs.remaining is not None:
        progress = progress.noted(inputs.remaining, now, limits.progress)
    return replace(state, progress=progress)


def _wait_for_sensors(state: State, now: float, limits: Limits) -> Step:
    """Stands still; gives up when a robot that drives would have done so, since recovery cannot bring sensors back."""
    if state.progress.is_hopeless(now, limits.progress):
        return _finish(Outcome.ABORTED, STALE_TEXT, Trigger.SENSORS)
    return state, STANDSTILL, (Warn(STALE_TEXT),)


def _watch_oscillation(state: State, pose: Pose | None, now: float, limits: Limits) -> State:
    """Resets the oscillation timer if the robot has moved by ``oscillation_distance``."""
    if pose is None:
        return state
    if (
        state.oscillation_pose is not None
        and pose.distance(state.oscillation_pose) < limits.oscillation_distance
    ):
        return state
    index = 0 if state.trigger in (Trigger.OSCILLATION, Trigger.PUSHING) else state.recovery_index
    return replace(state, last_oscillation_reset=now, oscillation_pose=pose, recovery_index=index)


def _request_plan(state: State, now: float) -> tuple[State, tuple[Event, ...]]:
    """Requests a plan if one is due; the outcome of this request sets the next due time."""
    if now < state.plan_due or state.phase not in (Phase.PLANNING, Phase.CONTROLLING):
        return state, ()
    return replace(state, plan_due=math.inf), (StartPlanning(),)


def _take_plan(state: State, inputs: Inputs, now: float, limits: Limits) -> Step:
    """Handles the outcome of the search; if the returned step has a velocity, the cycle ends here."""
    if state.phase not in (Phase.PLANNING, Phase.CONTROLLING) or inputs.plan is PlanOutcome.NONE:
        return state, None, ()
    state = replace(state, last_search=now)
    searched = state.goal if inputs.searched_goal is None else inputs.searched_goal
    # A search to an earlier goal leaves the active one without a plan.
    further: tuple[Event, ...] = () if searched == state.goal else (StartPlanning(),)
    if inputs.plan is PlanOutcome.FAILED:
        if searched > state.planned_goal and state.phase is Phase.CONTROLLING:
            return _stop_and_plan(state, now)
        if further:
            return state, None, further
        return _planning_failed(state, inputs, now, limits)
    started = state.phase is Phase.PLANNING
    state = replace(
        state,
        phase=Phase.CONTROLLING,
        planned_goal=searched,
        last_valid_plan=now,
        planning_retries=0,
        plan_due=math.inf if further else now + limits.planning_period,
        recovery_index=0 if state.trigger is Trigger.PLANNING else state.recovery_index,
    )
    return state, STANDSTILL if started else None, (FollowPlan(), *further)


def _stop_and_plan(state: State, now: float) -> Step:
    """Stops the robot, which has no plan that it may follow; the next search starts in the next cycle."""
    state = replace(
        state, phase=Phase.PLANNING, last_valid_plan=now, planning_retries=0, plan_due=now
    )
    return state, STANDSTILL, ()


def _planning_failed(state: State, inputs: Inputs, now: float, limits: Limits) -> Step:
    """Retries until patience or retries are exhausted; a moving robot keeps its current plan until it is blocked."""
    period = (
        min(limits.planning_period, RETRY_PERIOD) if math.isfinite(limits.planning_period) else 0.0
    )
    if state.phase is Phase.CONTROLLING:
        if inputs.blocked_near:
            return _stop_and_plan(state, now)
        return replace(state, plan_due=now + limits.planning_period), None, ()
    retries = state.planning_retries + 1
    state = replace(state, planning_retries=retries, plan_due=now + period)
    exhausted = 0 <= limits.max_planning_retries < retries
    if exhausted or now > state.last_valid_plan + limits.planner_patience:
        return _clear(state, Trigger.PLANNING)
    return state, None, ()


def _clear(state: State, trigger: Trigger) -> Step:
    """Stops the robot and enters recovery."""
    state = replace(
        state, phase=Phase.CLEARING, trigger=trigger, recovering=False, plan_due=math.inf
    )
    return state, STANDSTILL, (StopPlanning(),)


def _control(state: State, inputs: Inputs, now: float, limits: Limits) -> Step:
    if inputs.reached:
        return _finish(Outcome.SUCCEEDED, "Goal reached.")
    if inputs.pushing:
        state, command, events = _clear(state, Trigger.PUSHING)
        return state, command, (Warn(PUSHING_TEXT), *events)
    waited = now - state.last_oscillation_reset
    if 0.0 < limits.oscillation_timeout < waited:
        return _clear(state, Trigger.OSCILLATION)
    if inputs.control is not None:
        index = 0 if state.trigger is Trigger.CONTROLLING else state.recovery_index
        return replace(state, last_valid_control=now, recovery_index=index), inputs.control, ()
    if now > state.last_valid_control + limits.controller_patience:
        return _clear(state, Trigger.CONTROLLING)
    state, command, _ = _stop_and_plan(state, now)
    return state, command, (StopPlanning(),)


def _recover(state: State, inputs: Inputs, now: float, limits: Limits) -> Step:
    if not state.recovering:
        if state.recovery_index >= limits.recoveries:
            return _finish(Outcome.ABORTED, state.trigger.value, state.trigger)
        return (
            replace(state, recovering=True, recovery_begun=now),
            None,
            (StartRecovery(state.recovery_index, state.trigger),),
        )
    if not inputs.recovered:
        return state, inputs.recovery, ()
    state = replace(
        state,
        phase=Phase.PLANNING,
        recovering=False,
        recovery_index=state.recovery_index + 1,
        last_oscillation_reset=now,
        last_valid_plan=now,
        planning_retries=0,
        plan_due=now,
        progress=state.progress.recovered(now - state.recovery_begun),
    )
    return state, STANDSTILL, ()
