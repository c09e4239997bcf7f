"""move_base without ROS: costmaps, planners, recovery and the state machine, one cycle at a time.

The node fills a ``Sight`` from topics and transforms and publishes the content of a ``Cycle``. A simulation can do
both itself.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.base.scan import Picture
from nav_bundle.base.velocity import Velocity
from nav_bundle.control.local_planner import (
    Decision,
    LocalPlanner,
    LocalPlannerError,
    Situation,
)
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.move_base.config import Setup
from nav_bundle.move_base.pushing import PushingWatch
from nav_bundle.move_base.reason import (
    DOES_NOT_MOVE,
    NO_REASON,
    Condition,
    Reason,
    failure,
    goal_reason,
    is_due,
    no_sensor_data,
    way_blocked,
    without_progress,
)
from nav_bundle.move_base.recovery import (
    BackUp,
    Recovery,
    SpeedLimit,
    Surroundings,
)
from nav_bundle.move_base.state_machine import (
    Event,
    Finish,
    FollowPlan,
    Inputs,
    Outcome,
    Phase,
    PlanOutcome,
    StartPlanning,
    StartRecovery,
    State,
    StopPlanning,
    Trigger,
    Warn,
    advance,
)
from nav_bundle.planning.plan_choice import PlanChoice
from nav_bundle.planning.planner import Path, PlannerError, Search

# Number of cells a search may visit in one cycle: about 60 ms while the robot stands, 8 ms while it drives.
_CELLS_STANDING = 2_000_000
_CELLS_DRIVING = 250_000
_NOBODY = np.empty((0, 2))
_NO_POSE = "Unable to get starting pose of robot, unable to create global plan"


@dataclass(frozen=True, eq=False)
class Sight:
    """Robot state in one cycle; None for unknown values."""

    pose: Pose | None  #: the robot's pose in the global costmap's frame
    local_pose: Pose | None = None  #: the robot's pose in the local costmap's frame
    local_from_global: Pose | None = (
        None  #: pose of the global costmap's frame in the local costmap's frame
    )
    velocity: Velocity | None = None  #: measured velocity
    current: bool = False  #: sensor data, odometry and transforms are recent enough to drive
    fault: str = ""  #: why they are not, for people; empty if they are
    #: other robots' poses by name, in the global costmap's frame
    robots: Mapping[str, Pose] = field(default_factory=dict)


@dataclass(frozen=True)
class Report:
    """What the robot is doing, why it does not arrive, and since when [s]."""

    condition: Condition = Condition.IDLE
    reason: Reason = NO_REASON
    since: float = 0.0

    def text(self) -> str:
        """Returns the report for people."""
        if not self.reason.text:
            return self.condition.value
        return f"{self.condition.value}: {self.reason.text}"


@dataclass(eq=False)
class Cycle:
    """Result of one cycle."""

    command: Velocity | None = None  #: velocity to command; None to leave the base alone
    decision: Decision | None = None  #: the local planner's decision
    plan: Path | None = None  #: the new global plan to follow
    found: Search | None = None  #: the search that ended with a path
    recovery: StartRecovery | None = None  #: the recovery behaviour that started
    finish: Finish | None = None  #: how the goal ended
    warnings: list[str] = field(default_factory=list)  #: lines for the log


class Navigator:
    """Drives to one goal at a time. Not thread-safe.

    Args:
        setup: parameters.
        global_costmap: updated by the caller before each cycle.
        local_costmap: updated by the caller before each cycle.
        refresh: updates both costmaps immediately; called after a recovery behaviour has changed them.
    """

    def __init__(
        self,
        setup: Setup,
        global_costmap: Costmap,
        local_costmap: Costmap,
        refresh: Callable[[], None],
    ) -> None:
        self._setup, self._refresh = setup, refresh
        self._global, self._local = global_costmap, local_costmap
        self.planner = setup.make_global_planner()
        self._limit: SpeedLimit | None = None  # of a recovery behaviour that has ended
        self._limited_at: Pose | None = None  # where the limit began, in the local costmap's frame
        self._controller = setup.make_local_planner()
        self._state = State()
        self._goal: Pose | None = None
        self._search: Search | PlannerError | None = (
            None  #: the error if the search could not start
        )
        self._searched_goal = 0  # number of the search's goal
        self._path: Path | None = None
        self._choice = PlanChoice()
        self._chosen_goal = (
            0  # number of the goal of ``_choice`` and of what the controller remembers
        )
        self._recovery: Recovery | None = None
        self._unmapped: NDArray[np.float64] = _NOBODY
        self._pushing = PushingWatch(setup.base.pushing_timeout)
        self._command: Velocity | None = None
        self._robots: Mapping[str, Pose] = {}
        self._fault = ""  # why an input does not allow driving
        self._reported = -math.inf  # time of the last change of the report
        self._failure = NO_REASON  # why the last goal was given up
        self.report = Report()  #: state after the last cycle

    def cell_costs(self) -> NDArray[np.float64]:
        """Returns the local costmap's cell costs of the last decision (n, 6); see ``Rollout.cell_costs``."""
        return self._controller.cell_costs()

    @property
    def phase(self) -> Phase:
        """Current phase of the state machine."""
        return self._state.phase

    def configure(self, setup: Setup) -> None:
        """Applies new parameters; keeps the current plan."""
        before, self._setup = self._setup, setup
        if (setup.global_planner_name, setup.global_planner) != (
            before.global_planner_name,
            before.global_planner,
        ):
            self.planner = setup.make_global_planner()
        self._pushing = PushingWatch(setup.base.pushing_timeout)
        if not setup.drives_as(before):
            self._renew_controller()

    def _make_controller(self) -> LocalPlanner:
        """Returns a new local planner, with the speeds that a recovery behaviour allows."""
        if self._limit is None:
            return self._setup.make_local_planner()
        if not hasattr(self._setup.local_planner, "limited"):
            return self._setup.make_local_planner()  # of another package, which knows no limit
        slow = self._setup.local_planner.limited(self._limit.speed, self._limit.turn)
        return replace(self._setup, local_planner=slow).make_local_planner()

    def _renew_controller(self) -> None:
        """Makes a new local planner that follows the same plan."""
        self._controller = self._make_controller()
        if self._choice.followed is not None:
            self._controller.set_plan(self._choice.followed.path)

    def _watch_limit(self, pose: Pose) -> None:
        """Lifts a recovery behaviour's speed limit once the robot has left the place."""
        if self._limit is None:
            return
        self._limited_at = self._limited_at or pose
        if pose.distance(self._limited_at) > self._limit.distance:
            self._limit = self._limited_at = None
            self._renew_controller()

    def look_around(self, pose: Pose | None, now: float) -> None:
        """Finds unmapped obstacles near ``pose`` and on the plan; call it after each update of the global costmap."""
        base = self._setup.base
        self._choice.check(self._global, pose, now)
        self._unmapped = _NOBODY
        if pose is not None:
            self._unmapped = self._global.unmapped(
                pose, base.meeting_distance, base.meeting_min_width
            )

    def look_at(self, picture: Picture) -> None:
        """Adds a scan, in the local costmap's frame, to the pushing detection."""
        if self._state.phase is Phase.CONTROLLING:
            self._pushing.note_picture(picture)

    def begin(self, goal: Pose, pose: Pose | None, now: float) -> Cycle:
        """Starts a new goal, in the global costmap's frame, from ``pose``.

        The command is None if the robot is driving: it follows its earlier plan until there is one to this goal.
        """
        self._goal = goal
        self._failure = NO_REASON
        return self._advance(Inputs(new_goal=True, pose=pose), pose, now, Cycle())

    def restart(self, pose: Pose | None, now: float) -> Cycle:
        """Restarts the current goal, if any, after the clock jumped back."""
        if self._goal is None:
            return Cycle()
        self._state = State()
        self._search = None
        return self.begin(self._goal, pose, now)

    def cancel(self, now: float) -> Cycle:
        """Cancels the current goal."""
        return self._advance(Inputs(cancel=True), None, now, Cycle())

    def cycle(self, sight: Sight, now: float) -> Cycle:
        """Runs one cycle at ROS time ``now`` [s]."""
        result = Cycle()
        if self._state.phase is Phase.IDLE:
            return result
        self._robots = sight.robots
        self._fault = sight.fault
        current = sight.current and sight.pose is not None and sight.local_pose is not None
        inputs = Inputs(
            pose=sight.pose,
            current=current,
            meeting=len(self._unmapped) > 0,
            remaining=self._choice.remaining(sight.pose),
            blocked=self._choice.blocked_at is not None,
            blocked_near=self._choice.is_blocked_near(sight.pose),
            discovered=self._choice.take_discovery(),
        )
        if current:
            inputs = self._worked_out(inputs, sight, now, result)
        return self._advance(inputs, sight.pose, now, result)

    def _worked_out(self, inputs: Inputs, sight: Sight, now: float, result: Cycle) -> Inputs:
        """Returns the inputs, completed with the outcomes of search, local planner and recovery."""
        inputs = replace(inputs, plan=self._search_on(result), searched_goal=self._searched_goal)
        if self._state.phase is Phase.CONTROLLING:
            self._pushing.note_motion(
                self._command, sight.velocity or Velocity(), sight.local_pose or Pose(), now
            )
            inputs = replace(inputs, pushing=self._pushing.pushes(now))
            result.decision = decision = self._decide(sight, result)
            return (
                inputs
                if decision is None
                else replace(inputs, control=decision.velocity, reached=decision.reached)
            )
        if self._recovery is not None:
            assert sight.pose is not None
            assert sight.local_pose is not None
            around = Surroundings(self._global, sight.pose, self._local, sight.local_pose, now)
            velocity = self._recovery.step(around)
            if velocity is None:
                self._end_recovery(result)
            return replace(inputs, recovery=velocity, recovered=velocity is None)
        return inputs

    def _search_on(self, result: Cycle) -> PlanOutcome:
        """Continues the search and returns its outcome."""
        if self._search is None:
            return PlanOutcome.NONE
        driving = self._state.phase is Phase.CONTROLLING
        try:
            if isinstance(self._search, PlannerError):
                raise self._search
            self._path = self._search.advance(_CELLS_DRIVING if driving else _CELLS_STANDING)
        except PlannerError as error:
            result.warnings.append(str(error))
            self._search = None
            return PlanOutcome.FAILED
        if self._path is None:
            return PlanOutcome.NONE
        result.found, self._search = self._search, None
        return PlanOutcome.FOUND

    def _decide(self, sight: Sight, result: Cycle) -> Decision | None:
        """Returns the local planner's decision; None if it finds no valid velocity or the robot state is unknown."""
        if (
            sight.pose is None
            or sight.local_pose is None
            or sight.local_from_global is None
            or sight.velocity is None
        ):
            return None
        self._watch_limit(sight.local_pose)
        fastest = self._setup.care.speed(self._unmapped, sight.pose)
        situation = Situation(
            self._local, sight.local_pose, sight.velocity, sight.local_from_global, fastest
        )
        try:
            return self._controller.decide(situation)
        except LocalPlannerError as error:
            result.warnings.append(str(error))
            return None

    def _end_recovery(self, result: Cycle) -> None:
        assert self._recovery is not None
        if self._recovery.complaint:
            result.warnings.append(self._recovery.complaint)
        if self._recovery.limit is not None:
            self._limit, self._limited_at = self._recovery.limit, None
            self._renew_controller()
        self._recovery = None
        self._refresh()

    def _advance(self, inputs: Inputs, pose: Pose | None, now: float, result: Cycle) -> Cycle:
        self._state, result.command, events = advance(self._state, inputs, now, self._setup.limits)
        for event in events:
            self._handle(event, pose, now, result)
        self._command = result.command
        if self._state.phase is not Phase.CONTROLLING:
            self._pushing.reset()
        if self._state.phase is not Phase.CLEARING:
            self._recovery = None
        is_another = inputs.new_goal or self._chosen_goal != self._state.goal
        if is_another and self._state.phase is not Phase.CONTROLLING:
            self._forget_plan(self._state.goal)
        condition, reason = self._condition(inputs, pose, now)
        self._update_report(condition, reason, now)
        return result

    def _update_report(self, condition: Condition, reason: Reason, now: float) -> None:
        """Reports a state and a reason that begin at once; a reason of which only the text changes, after a while."""
        report = self.report
        begins = (condition, reason.code) != (report.condition, report.reason.code)
        if begins or is_due(reason.text, report.reason.text, now - self._reported):
            self.report = Report(condition, reason, now if begins else report.since)
            self._reported = now

    def _condition(self, inputs: Inputs, pose: Pose | None, now: float) -> tuple[Condition, Reason]:
        """Returns what the robot is doing, and why it does not arrive."""
        state = self._state
        if state.phase is Phase.IDLE:
            return (
                Condition.FAILED if self._failure is not NO_REASON else Condition.IDLE
            ), self._failure
        if not (inputs.current or inputs.new_goal):
            return Condition.BLOCKED, no_sensor_data(self._fault)
        reason = self._hindrance(pose, now)
        if state.phase is Phase.CLEARING:
            pushes = state.trigger is Trigger.PUSHING
            return Condition.RECOVERING, DOES_NOT_MOVE if pushes else reason or without_progress(
                state.trigger, pose
            )
        return (Condition.DRIVING, NO_REASON) if reason is None else (Condition.BLOCKED, reason)

    def _hindrance(self, pose: Pose | None, now: float) -> Reason | None:
        """Returns what keeps the robot from driving to its goal; None while it makes progress."""
        assert self._goal is not None
        stands = self._state.phase is not Phase.CONTROLLING
        blocked_at = self._choice.blocked_at
        if blocked_at is not None and (stands or self._choice.is_blocked_near(pose)):
            return goal_reason(self._global, self._goal, self._robots) or way_blocked(
                blocked_at, self._robots
            )
        progress = self._state.progress
        if now - max(progress.since, progress.changed) > self._setup.limits.progress.timeout / 2.0:
            return without_progress(None, pose)
        return None

    def _handle(self, event: Event, pose: Pose | None, now: float, result: Cycle) -> None:
        match event:
            case StartPlanning():
                self._start_planning(pose)
            case StopPlanning():
                self._search = None
            case FollowPlan():
                assert self._path is not None
                if self._chosen_goal != self._searched_goal:
                    self._forget_plan(self._searched_goal)
                if self._choice.takes(self._path, result.found, now):
                    self._controller.set_plan(self._path)
                assert self._choice.followed is not None
                result.plan = self._choice.followed.path
            case StartRecovery(index, trigger):
                chosen: Recovery = self._setup.recoveries[index]
                chosen = BackUp(chosen) if trigger is Trigger.PUSHING else chosen
                chosen.start()
                self._recovery = chosen
                self._choice.note_cleared(self._global.marked())
                result.recovery = event
            case Finish():
                result.finish = self._explained(event, pose)
                self._goal, self._recovery = None, None
            case Warn(text):
                result.warnings.append(text)

    def _forget_plan(self, goal: int) -> None:
        """Forgets the plan and all that it brought: nothing of it applies to ``goal``, even at the same place."""
        self._chosen_goal = goal
        self._choice = PlanChoice()
        self._controller = self._make_controller()

    def _explained(self, finish: Finish, pose: Pose | None) -> Finish:
        """Returns ``finish`` with the reason in its text, if the goal was given up."""
        if finish.outcome is not Outcome.ABORTED:
            return finish
        assert self._goal is not None
        blocked = self._choice.last_blocked
        self._failure = failure(
            finish.trigger, self._global, self._goal, pose, blocked, self._robots
        )
        return replace(finish, text=f"{finish.text} {self._failure.sentence()}")

    def _start_planning(self, pose: Pose | None) -> None:
        """Starts a search unless one runs; if the start or goal is outside the map, it fails in the next cycle."""
        assert self._goal is not None
        if self._search is not None:
            return
        self._searched_goal = self._state.goal
        try:
            if pose is None:
                raise PlannerError(_NO_POSE)
            self._search = self.planner.search(self._global, pose, self._goal)
        except PlannerError as error:
            self._search = error
