"""What one robot knows of the others: their reports, who is lost, and who is an obstacle where it stands."""

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

from pioneer_traffic.config import CoordinatorConfig
from pioneer_traffic.foresight import Foresight
from pioneer_traffic.geometry import Point
from pioneer_traffic.report import NO_PLAN, Plan, PlanId, Report
from pioneer_traffic.roadmap import Roadmap, Way

_MOVED = 0.1
"""Distance by which a robot that stands must move to count as an obstacle elsewhere [m]: localisation is not exact."""
_KEPT = 100
"""Number of positions of other robots whose surroundings are stored."""
TOLERANCE = 0.5 * _MOVED
"""By how much a robot may pass another one nearer than the clearance, and by how much farther plans lead past it [m].

Together, they make sure that robots can drive a plan that was made before the other robot's position changed a bit.
"""


@dataclass(frozen=True)
class Occupied:
    """What robots that take no part keep from the others."""

    places: frozenset[int]
    ways: frozenset[Way]  #: with their directions


class Obstruction(NamedTuple):
    """Why a robot waits."""

    text: str
    robots: tuple[str, ...] = ()  #: names of the robots that have to pass first or stand in the way


class Neighbours:
    """The other robots, by their reports.

    Args:
        robot: the name of this robot.
        roadmap: this robot's.
        config: the same for all robots.
    """

    def __init__(self, robot: str, roadmap: Roadmap, config: CoordinatorConfig) -> None:
        #: the plans, and what the others may hold by these
        self.foresight = Foresight(robot, roadmap, config)
        self._roadmap = roadmap
        self._config = config
        self._signature = roadmap.signature
        self.reports: dict[str, Report] = {}  #: the newest one of each robot that is not forgotten
        self._heard_at: dict[str, float] = {}
        #: by robot, the position at which it counts as an obstacle
        self._standing: dict[str, Point] = {}
        self._occupied: dict[Point, Occupied] = {}  # by position of a robot that takes no part

    def receive(self, report: Report, now: float) -> None:
        """Stores a report; a robot with a different roadmap becomes an obstacle."""
        if report.roadmap != self._signature:
            # Its numbers of places and plans mean something else here.
            report = replace(report, held=(), plan=None, adopted=PlanId(), ready=PlanId())
        self.foresight.learn(report.plan, now)
        self.reports[report.robot] = report
        self._heard_at[report.robot] = now

    def fresh(self, now: float) -> dict[str, Report]:
        """Returns the reports of the robots that are not lost."""
        lease = self._config.lease
        return {
            name: report
            for name, report in self.reports.items()
            if now - self._heard_at[name] <= lease
        }

    def restart_clock(self) -> None:
        """Counts all robots as lost, because the clock jumped back; they have to be heard again."""
        self._heard_at = dict.fromkeys(self._heard_at, -math.inf)
        self.foresight.restart_clock()

    def forget_removed(self, now: float) -> None:
        """Forgets the robots that have been silent for so long that they may have been removed."""
        for name, heard_at in list(self._heard_at.items()):
            if math.isinf(heard_at):
                # The clock has just jumped back: lost, but not for long.
                self._heard_at[name] = now - 2.0 * self._config.lease
            elif now - heard_at > self._config.memory:
                del self._heard_at[name], self.reports[name]
                self._standing.pop(name, None)

    def of(self, plan: Plan) -> list[Report]:
        """Returns the reports of the other robots in a plan."""
        return [self.reports[name] for name in plan.paths if name in self.reports]

    def need_room(self, plan: Plan, held: Collection[int]) -> bool:
        """Returns whether a robot in the plan cannot reach its goal by it, or only over places that are held."""
        return any(_needs_room(report, plan, held) for report in self.of(plan))

    def barred(self, partners: Collection[str], obstacles: Iterable[Point]) -> frozenset[int]:
        """Returns the places near robots that are lost or take no part, and near ``obstacles``."""
        return self.occupied(partners, obstacles).places

    def occupied(self, partners: Collection[str], obstacles: Iterable[Point]) -> Occupied:
        """Returns what robots that are lost or take no part, and ``obstacles``, keep from the others."""
        outsiders = [report for name, report in self.reports.items() if name not in partners]
        points = [*obstacles, *(self.standing_at(report) for report in outsiders)]
        ways: set[Way] = set()
        places = self._all_held(outsiders)
        for point in points:
            around = self._occupied.get(point) or self._occupied_around(point)
            places |= around.places
            ways |= around.ways
        return Occupied(frozenset(places), frozenset(ways))

    def _occupied_around(self, point: Point) -> Occupied:
        """Returns what a robot at a point keeps from the others, and stores it: most robots stand for long."""
        if len(self._occupied) >= _KEPT:
            self._occupied.clear()
        least = self._roadmap.config.clearance + TOLERANCE
        found = Occupied(self._roadmap.near(point, point), self._roadmap.ways_towards(point, least))
        self._occupied[point] = found
        return found

    def obstruction(self, plan: Plan, fresh: Collection[str]) -> Obstruction:
        """Returns what blocks the way of a robot that waits for no other by the plan.

        Args:
            plan: the robot's.
            fresh: names of the robots that are not lost.
        """
        aside = tuple(sorted(set(self.reports) - set(plan.paths)))
        if not aside:
            return Obstruction("the right of way found no way to the goal")
        return Obstruction(f"no way leads past {listed(aside, fresh)}", aside)

    def exclusion(self, fresh: Collection[str]) -> Obstruction:
        """Returns why a robot is in no plan; ``fresh`` are the names of the robots that are not lost."""
        names = tuple(sorted(self.reports))
        if not names:
            return Obstruction("no plan includes the robot")
        return Obstruction(f"no place is free, among {listed(names, fresh)}", names)

    def held_outside(self, plan: Plan, fresh: dict[str, Report]) -> set[int]:
        """Returns the places that robots outside a plan may hold, of those that are not lost."""
        outsiders = [report for report in fresh.values() if report.robot not in plan.paths]
        return self._all_held(outsiders)

    def _all_held(self, reports: Iterable[Report]) -> set[int]:
        """Returns the places that any of these robots may hold by now."""
        held: set[int] = set()
        for report in reports:
            held |= self.foresight.may_hold(report, self._heard_at[report.robot])
        return held

    def needed(self, plan: Plan, fresh: dict[str, Report]) -> set[int]:
        """Returns the places that any other robot holds or will pass by a plan, or may hold outside it."""
        places = self.held_outside(plan, fresh)
        for report in self.of(plan):
            places.update(report.held)
            passed = max(0, report.reached) if report.adopted == plan.id else 0
            places.update(plan.paths[report.robot][passed:])
            places.update(plan.regions.get(report.robot, ()))
        return places

    def strays(self) -> list[Point]:
        """Returns the positions of robots that are away from what they hold, or that hold nothing."""
        return [report.position for report in self.reports.values() if self._is_stray(report)]

    def _is_stray(self, report: Report) -> bool:
        if not report.held:
            return True
        return not self._roadmap.is_near_held(report.held, report.position, self._config.stray)

    def standing_at(self, report: Report) -> Point:
        """Returns the position of a robot outside the plan; without small movements, or each made a new plan."""
        before = self._standing.get(report.robot, report.position)
        here = before if math.dist(before, report.position) < _MOVED else report.position
        self._standing[report.robot] = here
        return here


def listed(names: Iterable[str], fresh: Collection[str]) -> str:
    """Returns names for people; says which robots send no reports."""
    return ", ".join(name if name in fresh else f"{name} (sends no reports)" for name in names)


def partners_of(own: Report, fresh: dict[str, Report]) -> list[Report]:
    """Returns the reports of the robots to plan for, by name; empty if another robot makes the plan.

    They hear one another, in both directions, and no two claim one place. The first by name makes the plan.
    """
    found: dict[str, Report] = {}
    claimed: set[int] = set()
    heard_by_all: set[str] = set()
    everyone = [own, *fresh.values()]
    for report in sorted(everyone, key=lambda report: (report.adopted == NO_PLAN, report.robot)):
        if not report.held or not claimed.isdisjoint(report.held):
            continue
        heard = set(report.heard)
        if found and not (report.robot in heard_by_all and heard.issuperset(found)):
            continue
        if report.robot < own.robot:
            return []
        heard_by_all = heard_by_all & heard if found else heard
        found[report.robot] = report
        claimed.update(report.held)
    return [found[name] for name in sorted(found)] if own.robot in found else []


def hear_one_another(plan: Plan, own: str, fresh: dict[str, Report]) -> bool:
    """Returns whether robot ``own`` and all others in a plan receive each other's reports."""
    return all(name == own or (name in fresh and own in fresh[name].heard) for name in plan.paths)


def ground_wanted(report: Report) -> tuple[int, ...]:
    """Returns the places that a robot off the roadmap uses, or that it will need at the goal to which it drives."""
    if report.out:
        return report.held[:-1]
    return report.region if report.has_taken_goal else ()


def _needs_room(report: Report, plan: Plan, held: Collection[int]) -> bool:
    """Returns whether a robot cannot reach its goal by the plan, or only over places that are held."""
    if report.goal < 0:
        return False
    return (
        plan.paths[report.robot][-1] != report.goal
        or comes_by(report, plan, held)
        or bool({*report.region} & {*held})
    )


def comes_by(report: Report, plan: Plan, region: Collection[int]) -> bool:
    """Returns whether a robot holds a place of a region or still passes one on its path."""
    return not {*report.held, *plan.paths[report.robot][report.reached + 1 :]}.isdisjoint(region)


def is_ready(report: Report, plan: Plan) -> bool:
    """Returns whether a robot has adopted the plan or can: it holds the places that the plan assumed, or fewer."""
    held = plan.held[report.robot]
    fits = report.stop == held[-1] and set(report.held) <= set(held)
    return report.adopted == plan.id or (report.ready == plan.id and fits)
