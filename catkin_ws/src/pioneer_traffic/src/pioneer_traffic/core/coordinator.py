"""Right of way for one robot: which places it may go to, agreed with the other robots by reports alone.

The robot with the lowest name among those that hear one another makes the plans. A plan counts once every robot in it
is ready for it: once it has reported this, a robot takes no further place by an older plan. Within a plan a robot
takes the next places of its path when those before it have left them. So no two robots hold one place, however late
reports are.
No ROS, no clock: the owner passes the time [s] and the robot's pose.
"""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

from pioneer_traffic.core.geometry import Point, distance_to_segment
from pioneer_traffic.core.planning import planned
from pioneer_traffic.core.report import Plan, PlanId, Report
from pioneer_traffic.core.roadmap import Roadmap


@dataclass(frozen=True)
class CoordinatorConfig:
    """Times [s] and distances [m]."""

    horizon: int = 3  #: places that a robot takes ahead
    #: distance at which a place or the waypoint counts as reached: the navigation's goal tolerance and a bit
    reach: float = 0.3
    lease: float = 2.0  #: a robot that has not been heard for so long is gone: an obstacle where it was last heard of
    patience: float = 20.0  #: how long to wait at the start for robots that are expected
    replan_period: float = 0.4  #: least time between two plans of one robot


class Coordinator:
    """One robot's part in the agreement.

    Args:
        name: the robot's.
        roadmap: the same for all robots.
        config: the same for all robots.
        expected: the other robots' names, as far as they are known.
    """

    def __init__(
        self, name: str, roadmap: Roadmap, config: CoordinatorConfig | None = None, expected: Iterable[str] = ()
    ) -> None:
        self._config = config or CoordinatorConfig()
        self._roadmap, self._expected = roadmap, frozenset(expected) - {name}
        self._own = Report(name, roadmap.signature, (0.0, 0.0))
        self._others: dict[str, Report] = {}
        self._heard_at: dict[str, float] = {}
        self._obstacles: tuple[Point, ...] = ()
        self._began, self._advanced_at, self._met_at = math.inf, -math.inf, -math.inf
        self._waypoint: Point | None = None
        self._visited: Point | None = None  # the waypoint for which the robot is off the roadmap
        self._plan = Plan()
        self._taken = 0  # index in the plan's path of the last place taken
        self._track: list[int] = []  # places taken, from the one reached last
        self._aside: tuple[int, ...] = ()  # places held beside the track: on the way to it, or off it
        self._made_at, self._made_for = -math.inf, ""
        self._wanted: dict[str, tuple[int, ...]] = {}  # by robot, the ground it wanted when last looked at
        #: points to drive to now, one after the other; the last is where to stop. Empty: stay.
        self.route: list[Point] = []
        self.finished = False  #: whether the waypoint has been reached

    @property
    def report(self) -> Report:
        """The robot's state, for all others."""
        return self._own

    def set_waypoint(self, waypoint: Point | None, now: float) -> bool:
        """Sets where to go, None for nowhere; False where no place of the roadmap is near enough."""
        self._waypoint, self.finished = None, False
        self._own = replace(self._own, goal=-1, region=())
        if waypoint is None:
            return True
        goal = next(self._roadmap.entries(waypoint), None)
        if goal is None:
            return False
        region: frozenset[int] = frozenset()
        if math.dist(self._roadmap.places[goal], waypoint) > 0.5 * self._config.reach:
            region = self._roadmap.near(self._roadmap.places[goal], waypoint, goal)
        self._own = replace(self._own, goal=goal, since=now, region=tuple(sorted(region)))
        self._waypoint = waypoint
        return True

    def set_obstacles(self, points: Iterable[Point]) -> None:
        """Sets where robots stand that send no reports."""
        self._obstacles = tuple(points)

    def receive(self, report: Report, now: float) -> None:
        """Stores another robot's report; one of another roadmap makes that robot an obstacle."""
        if report.robot != self._own.robot:
            same = report.roadmap == self._own.roadmap
            self._others[report.robot] = report if same else replace(report, held=(), plan=None)
            self._heard_at[report.robot] = now

    def advance(self, position: Point, now: float) -> Report:
        """Takes what may be taken, updates ``route`` and ``finished``, and returns the report to send."""
        self._began = min(self._began, now)
        fresh = self._fresh(now)
        # Who comes back hears one robot after the other: what it knows of the rest is old.
        if now - self._advanced_at > self._config.lease or not fresh.keys() <= set(self._own.heard):
            self._met_at = now
        self._advanced_at = now
        self._own = replace(self._own, position=position, heard=tuple(sorted(fresh)))
        self._enter_if_left_out()
        self._progress()
        self._make_plan_if_due(fresh, now)
        self._follow_newest(fresh)
        if self._own.ready == self._plan.id and self._hear_one_another(fresh):
            self._take(fresh)
            self._leave(fresh)
        self._visit()
        return self._own

    def _fresh(self, now: float) -> dict[str, Report]:
        """Returns the reports of the robots that are not gone."""
        return {
            name: report
            for name, report in self._others.items()
            if 0.0 <= now - self._heard_at[name] <= self._config.lease
        }

    def _place(self, index: int) -> Point:
        return self._roadmap.places[self._track[index]]

    def _is_near(self, point: Point) -> bool:
        return math.dist(self._own.position, point) <= self._config.reach

    def _enter_if_left_out(self) -> None:
        """Claims the nearest place that no other robot holds or stands at, with those that the way there comes near.

        That is for a robot that no plan leads and that has no place yet, or one that is also another robot's.
        """
        own = self._own
        if own.robot in self._plan.paths:
            return
        others = {
            place
            for report in self._others.values()
            if report.adopted != PlanId() or report.robot < own.robot
            for place in report.held
        }
        if self._track and not others & set(own.held) and not self._leads_by_another(self._track[0]):
            return
        self._track, self._aside = [], ()
        for place in self._roadmap.entries(own.position):
            aside = self._roadmap.near(own.position, self._roadmap.places[place], place)
            if not others & {place, *aside} and not self._leads_by_another(place):
                self._track, self._aside = [place], tuple(sorted(aside))
                break
        self._publish_held()

    def _leads_by_another(self, place: int) -> bool:
        """Tells whether the way to a place comes nearer to a robot without a plan than a clearance, and than it is."""
        own, end, least = self._own.position, self._roadmap.places[place], self._roadmap.config.clearance
        standing = [report.position for report in self._others.values() if report.adopted == PlanId()]
        return any(distance_to_segment(at, own, end) < min(least, math.dist(own, at)) - 1e-6 for at in standing)

    def _publish_held(self) -> None:
        reached = -1 if self._aside and not self._own.out else max(-1, self._taken - len(self._track) + 1)
        self._own = replace(self._own, held=(*self._aside, *self._track), reached=reached)

    def _progress(self) -> None:
        """Lets go of the places that the robot has left behind."""
        if self._own.robot not in self._plan.paths:
            self.route = []
            return
        if self._own.out:
            return
        near = (index for index in range(len(self._track) - 1, -1, -1) if self._is_near(self._place(index)))
        passed = next(near, -1)
        if passed >= 0:
            # Navigation goes to the end of the route as it likes: it need not have come by the first place.
            self._aside = ()
        if not self._aside:
            del self._track[: max(passed, int(self._is_past_second()))]
        self._publish_held()
        self.route = [self._place(index) for index in range(min(1, len(self._track) - 1), len(self._track))]
        if self._aside:
            self.route.insert(0, self._place(0))

    def _is_past_second(self) -> bool:
        """Tells whether the robot is on its way from the second place taken to the third."""
        if len(self._track) < 3:
            return False
        return distance_to_segment(self._own.position, self._place(1), self._place(2)) <= self._config.reach

    def _make_plan_if_due(self, fresh: dict[str, Report], now: float) -> None:
        """Makes a plan where this robot is the one to make it and the last one no longer fits."""
        config = self._config
        is_complete = self._expected <= self._others.keys() or now - self._began >= config.patience
        is_settled = now - self._met_at >= config.lease and now - self._made_at >= config.replan_period
        if not (is_complete and is_settled):
            return
        reports = self._partners(fresh)
        if not reports or self._own.robot != min(report.robot for report in reports):
            return
        barred = self._barred({report.robot for report in reports})
        made_for = repr(([(one.robot, one.goal, one.out and one.goal != one.stop) for one in reports], sorted(barred)))
        # Who leaves its goal to let others pass wants no ground until it is back: that plan still fits.
        wanted, before = {one.robot: _ground_wanted(one) for one in reports}, self._wanted
        self._wanted = wanted
        wants_more = any(ground and ground != before.get(name) for name, ground in wanted.items())
        if made_for == self._made_for and not wants_more and not self._is_overtaken(reports, now):
            return
        self._made_at, self._made_for = now, made_for
        number = 1 + max(report.ready.number for report in (self._own, *self._others.values()))
        plan = planned(self._roadmap, reports, barred, PlanId(number, self._own.robot))
        self._own = replace(self._own, plan=plan)

    def _partners(self, fresh: dict[str, Report]) -> list[Report]:
        """Returns the reports of the robots that can be planned for: of two that claim one place, one alone."""
        found, claimed = list[Report](), set[int]()
        everyone = [self._own, *fresh.values()]
        for report in sorted(everyone, key=lambda report: (report.adopted == PlanId(), report.robot)):
            if report.held and not claimed & set(report.held):
                found.append(report)
                claimed.update(report.held)
        return sorted(found, key=lambda report: report.robot)

    def _is_overtaken(self, reports: Sequence[Report], now: float) -> bool:
        """Tells whether this robot's newest plan leads no further: not the newest, not to be adopted, or driven."""
        plan = self._own.plan
        if plan is None or plan.id < self._own.ready or plan.paths.keys() != {report.robot for report in reports}:
            return True
        if any(one.ready == plan.id and not _is_ready(one, plan) for one in reports):
            return True
        driven = all(one.adopted == plan.id and one.reached == len(plan.paths[one.robot]) - 1 for one in reports)
        missing = any(
            one.goal not in (-1, one.stop) or not set(_ground_wanted(one)) <= set(plan.regions.get(one.robot, ()))
            for one in reports
        )
        return driven and missing and now - self._made_at > self._config.lease

    def _barred(self, partners: set[str]) -> frozenset[int]:
        """Returns the places near robots that are gone or never took part."""
        outsiders = [report for name, report in self._others.items() if name not in partners]
        points = [*self._obstacles, *(report.position for report in outsiders)]
        near = (self._roadmap.near(point, point) for point in points)
        return frozenset[int]().union(*near, *(report.held for report in outsiders))

    def _follow_newest(self, fresh: dict[str, Report]) -> None:
        """Gets ready for the newest plan, and adopts it once all robots in it are ready."""
        plans = [report.plan for report in (self._own, *fresh.values()) if report.plan is not None]
        newest = max(plans, key=lambda plan: plan.id, default=None)
        if newest is None or newest.id <= self._plan.id:
            return
        self._own = replace(self._own, ready=max(self._own.ready, newest.id))
        if self._own.robot not in newest.paths:
            if len(self._track) <= 1 and not self._own.out:
                self._plan, self._own = Plan(), replace(self._own, adopted=PlanId())
            return
        everyone = {**fresh, self._own.robot: self._own}
        if all(name in everyone and _is_ready(everyone[name], newest) for name in newest.paths):
            self._plan, self._taken = newest, 0
            self._own = replace(self._own, adopted=newest.id)
            self._publish_held()

    def _hear_one_another(self, fresh: dict[str, Report]) -> bool:
        own = self._own.robot
        return all(name == own or (name in fresh and own in fresh[name].heard) for name in self._plan.paths)

    def _take(self, fresh: dict[str, Report]) -> None:
        """Takes the next places of the path that no robot has to pass before, or holds without part in the plan."""
        path = self._plan.paths.get(self._own.robot, ())
        held = self._held_outside(fresh)
        while self._taken + 1 < len(path) and len(self._track) <= self._config.horizon and not self._own.out:
            index = self._taken + 1
            waits = (wait for wait in self._plan.waits if wait.robot == self._own.robot and wait.step == index)
            if path[index] in held or not all(self._has_left(*wait[2:], path[index]) for wait in waits):
                return
            self._taken = index
            self._track.append(path[index])
            self._publish_held()

    def _held_outside(self, fresh: dict[str, Report]) -> set[int]:
        """Returns what is held by robots that have no part in the plan."""
        return {place for report in fresh.values() if report.robot not in self._plan.paths for place in report.held}

    def _has_left(self, name: str, index: int, place: int) -> bool:
        other = self._others[name]
        return other.adopted == self._plan.id and (other.reached >= index or (index == 0 and place not in other.held))

    def _leave(self, fresh: dict[str, Report]) -> None:
        """Leaves the roadmap for the waypoint, from a goal that is reached, where the plan grants the places near.

        A robot without part in the plan may have claimed some of them since.
        """
        own, plan = self._own, self._plan
        if (
            self._waypoint is None
            or self.finished
            or own.out
            or not own.has_arrived
            or not self._is_near(self._place(0))
        ):
            return
        if not own.region:
            self.finished = True
            return
        others = [self._others[name] for name in plan.paths if name != own.robot]
        free = all(other.adopted == plan.id and not _comes_by(other, plan, own.region) for other in others)
        free = free and self._held_outside(fresh).isdisjoint(own.region)
        if free and set(own.region) <= set(plan.regions.get(own.robot, ())):
            self._visited, self._aside = self._waypoint, own.region
            self._own = replace(own, out=True)
            self._publish_held()

    def _visit(self) -> None:
        """Drives to the waypoint off the roadmap and, when another one is set, back."""
        if not self._own.out:
            return
        if self._visited == self._waypoint and self._visited is not None:
            self.route = [self._visited]
            self.finished = self.finished or self._is_near(self._visited)
        else:
            self.route = [self._place(0)]
            if self._is_near(self._place(0)):
                self._aside, self._own = (), replace(self._own, out=False)
                self._publish_held()


def _ground_wanted(report: Report) -> tuple[int, ...]:
    """Returns the places off the roadmap's ways that a robot uses, or that it waits for at its goal."""
    if report.out:
        return report.held[:-1]
    return report.region if report.has_arrived else ()


def _comes_by(report: Report, plan: Plan, region: Collection[int]) -> bool:
    """Tells whether a robot holds a place of a region, or will on its path."""
    return not {*report.held, *plan.paths[report.robot][report.reached + 1 :]}.isdisjoint(region)


def _is_ready(report: Report, plan: Plan) -> bool:
    """Tells whether a robot follows the plan, or will: it holds what the plan was made for, or less."""
    held = plan.held[report.robot]
    fits = report.stop == held[-1] and set(report.held) <= set(held)
    return report.adopted == plan.id or (report.ready == plan.id and fits)
