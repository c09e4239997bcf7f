"""move_base without ROS: costmaps, planners, recovery and the state machine, one cycle at a time.

The node fills a ``Sight`` from topics and transforms and publishes the content of a ``Cycle``. A simulation can do
both itself.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core.costmap.cost import INSCRIBED
from nav_bundle.core.costmap.costmap import Costmap
from nav_bundle.core.followed_plan import FollowedPlan, cost_of
from nav_bundle.core.local_planner import Decision, LocalPlannerError, Situation, Velocity
from nav_bundle.core.move_base import (
    Event,
    Finish,
    FollowPlan,
    Inputs,
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
from nav_bundle.core.move_base_config import Setup
from nav_bundle.core.navfn import NavfnSearch
from nav_bundle.core.planner import Path, PlannerError, Search
from nav_bundle.core.pose import Pose
from nav_bundle.core.pushing import Picture, PushingWatch
from nav_bundle.core.recovery import BackUp, Recovery, Surroundings

# Number of cells a search may visit in one cycle: about 60 ms while the robot stands, 8 ms while it drives.
_CELLS_STANDING = 2_000_000
_CELLS_DRIVING = 250_000
_SAME_PLACE = 1.0
"""Plans that are blocked less than this distance [m] apart are blocked by the same obstacle."""
_BLOCKED_NEAR = 1.5
"""A robot without another plan stops at this distance [m] from the place where its plan is blocked."""
_SURELY_FREE = 3.0
"""A place where a plan was blocked counts as passable after this time [s] without an obstacle."""
_BETTER = 0.9
"""A plan that leads another way replaces the current one if its cost is below this share of the current one's."""
_NOBODY = np.empty((0, 2))
_NO_POSE = "Unable to get starting pose of robot, unable to create global plan"


@dataclass(frozen=True, eq=False)
class Sight:
    """Robot state in one cycle; None for unknown values."""

    pose: Pose | None  #: the robot's pose in the global costmap's frame
    local_pose: Pose | None = None  #: the robot's pose in the local costmap's frame
    local_from_global: Pose | None = None  #: pose of the global costmap's frame in the local costmap's frame
    velocity: Velocity | None = None  #: measured velocity
    current: bool = False  #: sensor data, odometry and transforms are recent enough to drive


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
        self, setup: Setup, global_costmap: Costmap, local_costmap: Costmap, refresh: Callable[[], None]
    ) -> None:
        self._setup, self._refresh = setup, refresh
        self._global, self._local = global_costmap, local_costmap
        self.planner = setup.make_global_planner()
        self._controller = setup.make_local_planner()
        self._state = State()
        self._goal: Pose | None = None
        self._search: Search | PlannerError | None = None  #: the error if the search could not start
        self._path: Path | None = None
        self._followed: FollowedPlan | None = None
        self._blocked_at: tuple[float, float] | None = None
        self._discovered = False
        # The places (x, y) where plans for this goal were blocked, and when each was last seen blocked.
        self._found_blocked: dict[tuple[float, float], float] = {}
        self._cleared: list[NDArray[np.float64]] = []  # obstacles known before each recovery behaviour (n, 2) [m]
        self._recovery: Recovery | None = None
        self._unmapped: NDArray[np.float64] = _NOBODY
        self._pushing = PushingWatch(setup.base.pushing_timeout)
        self._command: Velocity | None = None

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
        if (setup.global_planner_name, setup.global_planner) != (before.global_planner_name, before.global_planner):
            self.planner = setup.make_global_planner()
        self._pushing = PushingWatch(setup.base.pushing_timeout)
        if not setup.drives_as(before):
            self._controller = setup.make_local_planner()
            if self._followed is not None:
                self._controller.set_plan(self._followed.path)

    def look_around(self, pose: Pose | None, now: float) -> None:
        """Finds unmapped obstacles near ``pose`` and on the plan; call it after each update of the global costmap."""
        base = self._setup.base
        self._check_plan(pose, now)
        self._unmapped = _NOBODY
        if pose is not None:
            self._unmapped = self._global.unmapped(pose, base.meeting_distance, base.meeting_min_width)

    def _check_plan(self, pose: Pose | None, now: float) -> None:
        """Finds the first place ahead where the plan is blocked, and whether it is a new one."""
        if self._followed is None or pose is None:
            self._blocked_at = None
            return
        for known in self._found_blocked:
            if self._global.cost_of_cell(*known) >= INSCRIBED:
                self._found_blocked[known] = now
        self._blocked_at = place = self._followed.blocked_at(self._global, pose)
        if place is not None:
            self._discovered |= not self._is_known(place)
            self._found_blocked[place] = now

    def _is_known(self, place: tuple[float, float]) -> bool:
        """Returns whether the obstacle at ``place`` was found for this goal before, maybe cleared by a recovery."""
        if any(math.dist(place, known) < _SAME_PLACE for known in self._found_blocked):
            return True
        return any(np.hypot(*(points - place).T).min(initial=np.inf) < _SAME_PLACE for points in self._cleared)

    def look_at(self, picture: Picture) -> None:
        """Adds a scan, in the local costmap's frame, to the pushing detection."""
        if self._state.phase is Phase.CONTROLLING:
            self._pushing.note_picture(picture)

    def begin(self, goal: Pose, pose: Pose | None, now: float) -> Cycle:
        """Starts a new goal, in the global costmap's frame, from ``pose``."""
        self._goal = goal
        self._followed, self._blocked_at = None, None
        self._found_blocked = {}
        self._cleared = []
        return self._advance(Inputs(new_goal=True, pose=pose), pose, now, Cycle())

    def restart(self, pose: Pose | None, now: float) -> Cycle:
        """Restarts the current goal, if any, after the clock jumped back."""
        return Cycle() if self._goal is None else self.begin(self._goal, pose, now)

    def cancel(self, now: float) -> Cycle:
        """Cancels the current goal."""
        return self._advance(Inputs(cancel=True), None, now, Cycle())

    def cycle(self, sight: Sight, now: float) -> Cycle:
        """Runs one cycle at ROS time ``now`` [s]."""
        result = Cycle()
        if self._state.phase is Phase.IDLE:
            return result
        current = sight.current and sight.pose is not None and sight.local_pose is not None
        inputs = Inputs(
            pose=sight.pose,
            current=current,
            meeting=len(self._unmapped) > 0,
            remaining=self._remaining(sight.pose),
            blocked=self._blocked_at is not None,
            blocked_near=self._is_blocked_near(sight.pose),
            discovered=self._discovered,
        )
        self._discovered = False
        if current:
            inputs = self._worked_out(inputs, sight, now, result)
        return self._advance(inputs, sight.pose, now, result)

    def _remaining(self, pose: Pose | None) -> float | None:
        """Returns the remaining way by the plan [m]; None without a plan, or if it is blocked."""
        if pose is None or self._followed is None:
            return None
        remaining = self._followed.pass_by(pose)
        return remaining if self._blocked_at is None else None

    def _is_blocked_near(self, pose: Pose | None) -> bool:
        """Returns whether the plan is blocked so near that driving on leads nowhere."""
        place = self._blocked_at
        return place is not None and pose is not None and math.dist(place, (pose.x, pose.y)) < _BLOCKED_NEAR

    def _worked_out(self, inputs: Inputs, sight: Sight, now: float, result: Cycle) -> Inputs:
        """Returns the inputs, completed with the outcomes of search, local planner and recovery."""
        inputs = replace(inputs, plan=self._search_on(result))
        if self._state.phase is Phase.CONTROLLING:
            self._pushing.note_motion(self._command, sight.velocity or Velocity(), sight.local_pose or Pose(), now)
            inputs = replace(inputs, pushing=self._pushing.pushes(now))
            result.decision = decision = self._decide(sight, result)
            return inputs if decision is None else replace(inputs, control=decision.velocity, reached=decision.reached)
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
        if sight.pose is None or sight.local_pose is None or sight.local_from_global is None or sight.velocity is None:
            return None
        fastest = self._setup.care.speed(self._unmapped, sight.pose)
        situation = Situation(self._local, sight.local_pose, sight.velocity, sight.local_from_global, fastest)
        try:
            return self._controller.decide(situation)
        except LocalPlannerError as error:
            result.warnings.append(str(error))
            return None

    def _end_recovery(self, result: Cycle) -> None:
        assert self._recovery is not None
        if self._recovery.complaint:
            result.warnings.append(self._recovery.complaint)
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
        if inputs.new_goal:
            # Nothing that the local planner remembers of the last goal applies to this one, even at the same place.
            self._controller = self._setup.make_local_planner()
        return result

    def _handle(self, event: Event, pose: Pose | None, now: float, result: Cycle) -> None:
        match event:
            case StartPlanning():
                self._start_planning(pose)
            case StopPlanning():
                self._search = None
            case FollowPlan():
                assert self._path is not None
                self._follow(self._path, result.found, now)
                assert self._followed is not None
                result.plan = self._followed.path
            case StartRecovery(index, trigger):
                chosen: Recovery = self._setup.recoveries[index]
                chosen = BackUp(chosen) if trigger is Trigger.PUSHING else chosen
                chosen.start()
                self._recovery = chosen
                self._cleared.append(self._global.marked())
                result.recovery = event
            case Finish():
                self._goal, self._followed, self._recovery = None, None, None
                result.finish = event
            case Warn(text):
                result.warnings.append(text)

    def _follow(self, path: Path, search: Search | None, now: float) -> None:
        """Follows ``path`` from now on, unless the current plan is as good."""
        followed = self._followed
        if followed is not None and not self._is_better(path, followed, search, now):
            return
        self._followed = FollowedPlan(path)
        self._blocked_at = None
        self._controller.set_plan(path)

    def _is_better(self, path: Path, followed: FollowedPlan, search: Search | None, now: float) -> bool:
        """Returns whether a new plan replaces the one that is followed.

        It does not where both lead different ways at nearly the same cost, or where it leads past a place that was
        blocked a moment ago: a robot that changes its mind halfway arrives nowhere.
        """
        if self._blocked_at is not None or followed.is_astray or followed.leads_as(path):
            return True
        if not isinstance(search, NavfnSearch) or not np.array_equal(path[-1], followed.path[-1]):
            return True
        doubtful = [place for place, time in self._found_blocked.items() if now - time < _SURELY_FREE]
        if any(np.hypot(path[:, 0] - x, path[:, 1] - y).min() < _SAME_PLACE for x, y in doubtful):
            return False
        costs, weights = search.costs, search.weights
        now = cost_of(followed.ahead, costs, search.geometry, weights)
        return cost_of(path, costs, search.geometry, weights) < _BETTER * now

    def _start_planning(self, pose: Pose | None) -> None:
        """Starts a search; if the start or goal is outside the map, it fails in the next cycle."""
        assert self._goal is not None
        try:
            if pose is None:
                raise PlannerError(_NO_POSE)
            self._search = self.planner.search(self._global, pose, self._goal)
        except PlannerError as error:
            self._search = error
