"""Where robots may be by now whose reports are late or lost: the places that they may have taken since.

A robot whose reports no longer arrive may still hear the others, and continue by the plan that it follows, until it
hears that they have lost it, or has lost them itself. What it may take until then is kept from the others.

No ROS, no clock.
"""

import math
from collections.abc import Iterator

from pioneer_traffic.config import CoordinatorConfig
from pioneer_traffic.report import Plan, PlanId, Report
from pioneer_traffic.roadmap import Roadmap

_KEPT = 50
"""Number of plans that are stored: the newest."""


class Foresight:
    """What one robot knows of the plans, and what the others may hold by these.

    Args:
        robot: the name of this robot.
        roadmap: this robot's.
        config: the same for all robots.
    """

    def __init__(self, robot: str, roadmap: Roadmap, config: CoordinatorConfig) -> None:
        self._robot = robot
        self._roadmap = roadmap
        self._config = config
        self._plans: dict[PlanId, Plan] = {}
        #: by plan, the time at which its author had made another one [s]: nobody can learn of the plan after that
        self._replaced_at: dict[PlanId, float] = {}
        #: by plan that this robot has adopted, the last place reached on its path
        self._own_reached: dict[PlanId, int] = {}

    def learn(self, plan: Plan | None, now: float) -> None:
        """Stores a plan that a robot has made."""
        if plan is None or plan.id in self._plans:
            return
        for other in self._plans:
            if other.author == plan.id.author:
                self._replaced_at.setdefault(other, now)
        self._plans[plan.id] = plan
        if len(self._plans) > _KEPT:
            oldest = min(self._plans)
            del self._plans[oldest]
            self._replaced_at.pop(oldest, None)
            self._own_reached.pop(oldest, None)

    def restart_clock(self) -> None:
        """Counts what happened before the clock jumped back as long ago."""
        self._replaced_at = dict.fromkeys(self._replaced_at, -math.inf)

    def note_own(self, report: Report) -> None:
        """Stores how far this robot has come by the plan that it follows."""
        if report.adopted in self._plans:
            self._own_reached[report.adopted] = report.reached

    def may_hold(self, report: Report, heard_at: float) -> set[int]:
        """Returns the places that a robot may hold by now: of its report, and what it may have taken since.

        Args:
            report: its newest one.
            heard_at: when that arrived [s].
        """
        places = set(report.held)
        for plan in self._plans.values():
            if report.robot in plan.paths and self._may_follow(report, heard_at, plan.id):
                places.update(self._ahead(report, plan))
        return places

    def _may_follow(self, report: Report, heard_at: float, plan: PlanId) -> bool:
        """Returns whether a robot may follow a plan by now: it takes no place by one if it knows a newer one."""
        if plan <= report.ready:
            return plan == report.ready
        # It did not know the plan. Its author sends the plan until it makes another one.
        return self._replaced_at.get(plan, math.inf) > heard_at - self._config.lease

    def _ahead(self, report: Report, plan: Plan) -> Iterator[int]:
        """Yields the places that a robot may have taken by a plan since its report."""
        path = plan.paths[report.robot]
        reached = max(0, report.reached) if report.adopted == plan.id else 0
        first_wait = self._first_wait(report.robot, plan, reached)
        last = self._last_reached(report, path, reached) + self._config.horizon
        yield from path[reached : min(last + 1, first_wait)]
        if last + 1 >= len(path) and first_wait == len(path):
            yield from plan.regions.get(report.robot, ())

    def _first_wait(self, robot: str, plan: Plan, reached: int) -> int:
        """Returns the first step, after the one reached, for which a robot still waits for this one."""
        waits = [
            wait.step
            for wait in plan.waits
            if wait.robot == robot
            and wait.other == self._robot
            and wait.step > reached
            and not self._has_made_way(plan.id, wait.other_step)
        ]
        return min(waits, default=len(plan.paths[robot]))

    def _has_made_way(self, plan: PlanId, step: int) -> bool:
        """Returns whether this robot may have reported that it has come to a step of its path in a plan."""
        own_reached = self._own_reached.get(plan)
        if own_reached is None:
            return False  # it has never followed that plan
        # What it holds before the first place of its path counts as left sooner.
        return step == 0 or own_reached >= step

    def _last_reached(self, report: Report, path: tuple[int, ...], reached: int) -> int:
        """Returns the last step that a robot can have reached before it notices that it is lost."""
        # It is lost after one lease, and may hear this robot, whose reports then show it, until another one has passed.
        left = 2.0 * self._config.lease * self._config.speed
        before = report.position
        for step in range(reached + 1, len(path)):
            place = self._roadmap.places[path[step]]
            left -= math.dist(before, place)
            if left < 0.0:
                return step - 1
            before = place
        return len(path) - 1
