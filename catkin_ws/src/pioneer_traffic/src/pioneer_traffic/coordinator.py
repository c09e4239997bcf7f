"""Right of way for one robot: agrees with the other robots, by reports alone, on the places that it may use.

Of the robots that hear one another, the one with the lowest name makes the plans. A robot that reports itself ready
for a plan takes no further place under an older one. The plan takes effect once all its robots are ready. Under a
plan a robot takes the next places of its path once the robots that pass before it have left them. So no two robots
in a plan ever hold the same place, however late reports arrive. Places that a robot outside the plan may have taken
since its last report count as held (``foresight``).

What a robot holds and where it is both count: a robot that is away from what it holds, or that holds nothing, is an
obstacle at its position, and a robot that finds itself elsewhere gives up what it held.

No ROS, no clock: the caller passes the time [s] and the robot's pose.
"""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

from pioneer_traffic.config import CoordinatorConfig
from pioneer_traffic.geometry import Point, distance_to_segment
from pioneer_traffic.neighbours import (
    TOLERANCE,
    Neighbours,
    Obstruction,
    comes_by,
    ground_wanted,
    hear_one_another,
    is_ready,
    listed,
    partners_of,
)
from pioneer_traffic.planning import planned
from pioneer_traffic.report import Plan, PlanId, Report, Wait
from pioneer_traffic.roadmap import Roadmap

_BAND = 0.6
"""Distance within which a robot that heads for a point straight has to come to its path [m]."""


class Coordinator:
    """One robot's part in the agreement.

    Args:
        name: of the robot.
        roadmap: the same for all robots.
        config: the same for all robots.
        expected: names of the other robots, as far as known.
    """

    def __init__(
        self,
        name: str,
        roadmap: Roadmap,
        config: CoordinatorConfig | None = None,
        expected: Iterable[str] = (),
    ) -> None:
        self._config = config or CoordinatorConfig()
        self._roadmap, self._expected = roadmap, frozenset(expected) - {name}
        self._own = Report(name, roadmap.signature, (0.0, 0.0))
        self._neighbours = Neighbours(name, roadmap, self._config)
        self._obstacles: tuple[Point, ...] = ()
        self._began, self._advanced_at, self._met_at = math.inf, -math.inf, -math.inf
        self._waypoint: Point | None = None
        self._visited: Point | None = None  # the waypoint for which the robot left the roadmap
        self._plan = Plan()
        self._waits_by_step: dict[int, list[Wait]] = {}  # of this robot, in the plan
        self._taken = 0  # index of the last place taken in the plan's path
        self._track: list[int] = []  # places taken, beginning with the last one reached
        self._aside: tuple[
            int, ...
        ] = ()  # places held besides the track: to enter it, or to leave the roadmap
        self._made_at, self._made_for = -math.inf, ""
        self._wanted: dict[
            str, tuple[int, ...]
        ] = {}  # by robot, the ground it wanted at the last check
        self._held = False  # whether this robot takes no part
        self._strays: tuple[Point, ...] = ()  # obstacles that no robot's held places cover
        #: points to drive through; the robot stops at the last one. Empty: it stays.
        self.route: list[Point] = []
        #: a point beyond the route to which the robot may head, because no other robot needs the ground up to there;
        #: the robot has to turn to the route's end as soon as this is None
        self.onward: Point | None = None
        self._is_exit_free = False  # whether the robot may leave the roadmap at its goal
        self.finished = False  #: whether the waypoint has been reached

    @property
    def report(self) -> Report:
        """This robot's report to all others."""
        return self._own

    @property
    def makes_way(self) -> bool:
        """Whether others need this robot to drive its route: the plan leads it elsewhere, or they need its ground."""
        is_led_away = len(self._plan.paths.get(self._own.robot, ())) > 1
        return is_led_away or self._neighbours.need_room(self._plan, self._own.held)

    def partners(self) -> dict[str, Point]:
        """Returns the positions of the other robots in the plan."""
        return {report.robot: report.position for report in self._neighbours.of(self._plan)}

    def obstruction(self) -> Obstruction:
        """Returns why the robot waits, naming the robots that have to pass first or stand in the way."""
        heard = self._own.heard
        path = self._plan.paths.get(self._own.robot, ())
        if not path:
            return self._neighbours.exclusion(heard)
        waits = self._waits(self._taken + 1)
        ahead = path[self._taken + 1] if self._taken + 1 < len(path) else -1
        first = sorted(
            {wait.other for wait in waits if not self._has_left(wait.other, wait.other_step, ahead)}
        )
        if first:
            return Obstruction(f"waits for {listed(first, heard)}", tuple(first))
        return self._neighbours.obstruction(self._plan, heard)

    def set_waypoint(self, waypoint: Point | None, now: float) -> bool:
        """Sets the waypoint, None for none; returns False if it is in a wall, or no place of the roadmap is near."""
        self._waypoint, self.finished = None, False
        self.onward = None
        self._is_exit_free = False
        self._own = replace(self._own, goal=-1, region=())
        if waypoint is None:
            return True
        goal = next(self._roadmap.exits(waypoint, 0.5 * self._config.reach), None)
        if goal is None or not self._roadmap.is_free(waypoint):
            return False
        self._own = replace(self._own, goal=goal[0], since=now, region=goal[1])
        self._waypoint = waypoint
        self._held = False
        self._return_on_the_way()
        return True

    def _return_on_the_way(self) -> None:
        """Lets a robot off the roadmap join its next path directly; it keeps the ground around it until then."""
        if self._own.out:
            self._visited = None
            self._own = replace(self._own, out=False)
            self._publish_held()

    def hold(self) -> None:
        """Takes the robot out of the agreement until it gets a waypoint: it stays, and others drive around it."""
        self.set_waypoint(None, 0.0)
        self._held = True
        self._withdraw()

    def _withdraw(self) -> None:
        """Gives up the plan and everything held: the robot is an obstacle at its position until it holds a place."""
        self._leave_plan()
        self._track = []
        self._aside = ()
        self.route = []
        self.onward = None
        self._own = replace(self._own, held=(), out=False, reached=-1)

    def set_obstacles(self, points: Iterable[Point]) -> None:
        """Sets the positions of robots that send no reports."""
        self._obstacles = tuple(points)

    def receive(self, report: Report, now: float) -> None:
        """Stores another robot's report; a robot with a different roadmap becomes an obstacle."""
        if report.robot != self._own.robot:
            self._neighbours.receive(report, now)

    def advance(self, position: Point, now: float) -> Report:
        """Takes the places that are free, updates ``route`` and ``finished``, and returns the report to send."""
        if now < self._advanced_at:
            self._restart_clock()
        self._began = min(self._began, now)
        self._neighbours.forget_removed(now)
        fresh = self._neighbours.fresh(now)
        # A robot that reconnects hears the others one by one: what it knows of the rest is stale.
        if now - self._advanced_at > self._config.lease or not fresh.keys() <= set(self._own.heard):
            self._met_at = now
        self._advanced_at = now
        self._own = replace(self._own, position=position, heard=tuple(sorted(fresh)))
        if self._is_carried():
            self._withdraw()
        self._strays = (*self._obstacles, *self._neighbours.strays())
        if not self._held:
            self._enter_if_left_out()
        self._avoid_occupied_ground(fresh)
        self._progress()
        self._finish_at_goal()
        self._make_plan_if_due(fresh, now)
        self._follow_newest(fresh)
        self._is_exit_free = False
        self.onward = None
        if self._own.ready == self._plan.id and hear_one_another(
            self._plan, self._own.robot, fresh
        ):
            self._take(fresh)
            self._is_exit_free = self._may_leave(fresh)
            self._leave()
            self.onward = self._farthest_onward(fresh)
        self._visit()
        self._neighbours.foresight.note_own(self._own)
        return self._own

    def _restart_clock(self) -> None:
        """Forgets the times from before the clock jumped back: the others have to be heard again."""
        self._began = math.inf
        self._advanced_at = -math.inf
        self._made_at = -math.inf
        self._neighbours.restart_clock()

    def _is_carried(self) -> bool:
        """Returns whether the robot is so far from what it holds that it has been carried elsewhere."""
        held = self._own.held
        return bool(held) and not self._roadmap.is_near_held(
            held, self._own.position, self._config.carried
        )

    def _is_way_free(self, start: Point, end: Point) -> bool:
        """Returns whether a way comes no nearer than the clearance to a stray robot, unless it leads away from it."""
        least = self._roadmap.config.clearance
        for stray in self._strays:
            allowed = min(least, math.dist(stray, start)) - TOLERANCE
            if distance_to_segment(stray, start, end) < allowed:
                return False
        return True

    def _is_way_on_free(self) -> bool:
        """Returns whether the way from where the robot is to the second place taken is free."""
        return self._is_way_free(self._own.position, self._place(1))

    def _is_way_over_first_free(self) -> bool:
        """Returns whether the way from where the robot is over the first to the second place taken is free."""
        first = self._place(0)
        return self._is_way_free(self._own.position, first) and self._is_way_free(
            first, self._place(1)
        )

    def _place(self, index: int) -> Point:
        return self._roadmap.places[self._track[index]]

    def _is_at_place(self, index: int) -> bool:
        """Returns whether the robot is at a place taken, or between its goal's place and its waypoint."""
        if self._is_near(self._place(index)):
            return True
        if self._track[index] != self._own.goal or self._waypoint is None:
            return False
        if self._is_exit_free:
            # The robot may head for the waypoint before it has come to the place.
            exit_distance = distance_to_segment(
                self._own.position, self._place(index), self._waypoint
            )
            return exit_distance <= self._config.reach
        return not self._own.region and self._is_near(self._waypoint)

    def _is_near(self, point: Point) -> bool:
        return math.dist(self._own.position, point) <= self._config.reach

    def _enter_if_left_out(self) -> None:
        """Claims the nearest place that no other robot holds or stands at, with all places near the path to it.

        Does nothing for a robot in a plan, or with a place of its own that no other robot claims.
        """
        own = self._own
        if own.robot in self._plan.paths:
            return
        others = {
            place
            for report in self._neighbours.reports.values()
            if report.adopted != PlanId() or report.robot < own.robot
            for place in report.held
        }
        if (
            self._track
            and not others & set(own.held)
            and not self._leads_by_another(self._track[0])
        ):
            return
        self._track, self._aside = [], ()
        for place in self._roadmap.entries(own.position):
            aside = self._roadmap.near(own.position, self._roadmap.places[place], place)
            if not others & {place, *aside} and not self._leads_by_another(place):
                self._track, self._aside = [place], tuple(sorted(aside))
                break
        self._publish_held()

    def _leads_by_another(self, place: int) -> bool:
        """Returns whether the path to a place comes within the clearance of a robot without a plan, nearer than now."""
        own, end, least = (
            self._own.position,
            self._roadmap.places[place],
            self._roadmap.config.clearance,
        )
        standing = [
            report.position
            for report in self._neighbours.reports.values()
            if report.adopted == PlanId()
        ]
        return any(
            distance_to_segment(at, own, end) < min(least, math.dist(own, at)) - 1e-6
            for at in standing
        )

    def _publish_held(self) -> None:
        reached = (
            -1 if self._aside and not self._own.out else max(-1, self._taken - len(self._track) + 1)
        )
        held = (*self._aside, *self._track)
        if held != self._own.held or reached != self._own.reached:
            self._own = replace(self._own, held=held, reached=reached)

    def _progress(self) -> None:
        """Releases the places that the robot has left behind."""
        if self._own.robot not in self._plan.paths:
            self.route = []
            return
        if self._own.out:
            return
        near = (index for index in range(len(self._track) - 1, -1, -1) if self._is_at_place(index))
        passed = next(near, -1)
        if passed >= 0 or self._is_on_first_way():
            # Navigation chooses its own path to the end of the route: it may have bypassed the first place.
            self._aside = ()
        if not self._aside:
            del self._track[: max(passed, int(self._is_past_second() or self._is_clear_of_first()))]
        self._give_up_blocked()
        self._publish_held()
        if self._own.robot not in self._plan.paths:
            self.route = []
            return
        self.route = [
            self._place(index) for index in range(min(1, len(self._track) - 1), len(self._track))
        ]
        if self._aside or (len(self._track) > 1 and not self._is_way_on_free()):
            self.route.insert(0, self._place(0))
        if not self._is_way_free(self._own.position, self.route[0]):
            self.route = []

    def _give_up_blocked(self) -> None:
        """Gives up the places taken ahead, from the first on whose way a stray robot stands."""
        for index in range(1, len(self._track)):
            if index == 1 and not self._aside:
                is_free = self._is_way_on_free() or self._is_way_over_first_free()
            else:
                is_free = self._is_way_free(self._place(index - 1), self._place(index))
            if not is_free:
                self._taken -= len(self._track) - index
                del self._track[index:]
                if self._taken < 0:
                    # The plan begins beyond: the robot needs another one.
                    self._leave_plan()
                return

    def _leave_plan(self) -> None:
        self._plan = Plan()
        self._waits_by_step = {}
        self._taken = 0
        self._own = replace(self._own, adopted=PlanId())

    def _is_past_second(self) -> bool:
        """Returns whether the robot is between the second and the third place taken."""
        if len(self._track) < 3:
            return False
        return (
            distance_to_segment(self._own.position, self._place(1), self._place(2))
            <= self._config.reach
        )

    def _is_on_first_way(self) -> bool:
        """Returns whether the robot is between the first and the second place taken."""
        if len(self._track) < 2:
            return False
        distance = distance_to_segment(self._own.position, self._place(0), self._place(1))
        return distance <= self._config.reach

    def _is_clear_of_first(self) -> bool:
        """Returns whether the robot is nearer to the next places taken than to the first, and clear of that one.

        Clear: no robot that comes to the first place, by any way that this robot does not hold, comes within the
        clearance. Navigation cuts corners: the robot may never come near the second place.
        """
        if len(self._track) < 3:
            return False
        position = self._own.position
        least = self._roadmap.config.clearance
        first = self._track[0]
        to_first_way = distance_to_segment(position, self._place(0), self._place(1))
        ahead = distance_to_segment(position, self._place(1), self._place(2))
        if ahead > to_first_way:
            return False
        others = [place for place in self._roadmap.neighbours[first] if place not in self._track]
        places = self._roadmap.places
        return math.dist(position, places[first]) >= least and all(
            distance_to_segment(position, places[first], places[other]) >= least for other in others
        )

    def _avoid_occupied_ground(self, fresh: dict[str, Report]) -> None:
        """Leaves the roadmap for the waypoint elsewhere if a robot that takes no part stands near the nearest place."""
        own = self._own
        if self._waypoint is None or own.out or own.robot not in self._plan.paths:
            return
        taking_part = {report.robot for report in fresh.values() if report.held}
        if len(taking_part) == len(self._neighbours.reports) and not self._obstacles:
            return
        barred = self._neighbours.barred(taking_part, self._obstacles)
        if barred.isdisjoint((own.goal, *own.region)):
            return
        for place, region in self._roadmap.exits(self._waypoint, 0.5 * self._config.reach):
            if barred.isdisjoint((place, *region)):
                self._own = replace(own, goal=place, region=region)
                return

    def _make_plan_if_due(self, fresh: dict[str, Report], now: float) -> None:
        """Makes a plan if this robot is the planner and the last plan no longer fits."""
        config = self._config
        is_complete = (
            self._expected <= self._neighbours.reports.keys()
            or now - self._began >= config.patience
        )
        is_settled = (
            now - self._met_at >= config.lease and now - self._made_at >= config.replan_period
        )
        if not (is_complete and is_settled):
            return
        reports = partners_of(self._own, fresh)
        if not reports:
            return
        occupied = self._neighbours.occupied({report.robot for report in reports}, self._obstacles)
        goals = [
            (report.robot, report.goal, report.out and report.goal != report.stop)
            for report in reports
        ]
        made_for = repr((goals, sorted(occupied.places), sorted(occupied.ways)))
        # A robot that leaves its goal to let others pass wants no ground until it is back: that plan still fits.
        wanted, before = {one.robot: ground_wanted(one) for one in reports}, self._wanted
        self._wanted = wanted
        wants_more = any(ground and ground != before.get(name) for name, ground in wanted.items())
        if made_for == self._made_for and not wants_more and not self._is_overtaken(reports, now):
            return
        self._made_at, self._made_for = now, made_for
        number = 1 + max(
            report.ready.number for report in (self._own, *self._neighbours.reports.values())
        )
        plan = planned(
            self._roadmap,
            reports,
            occupied.places,
            PlanId(number, self._own.robot),
            occupied.ways,
        )
        self._neighbours.foresight.learn(plan, now)
        self._own = replace(self._own, plan=plan)

    def _is_overtaken(self, reports: Sequence[Report], now: float) -> bool:
        """Returns whether this robot's last plan is obsolete: not the newest, impossible to adopt, or completed."""
        plan = self._own.plan
        if (
            plan is None
            or plan.id < self._own.ready
            or plan.paths.keys() != {report.robot for report in reports}
        ):
            return True
        if any(one.ready == plan.id and not is_ready(one, plan) for one in reports):
            return True
        driven = all(
            one.adopted == plan.id and one.reached == len(plan.paths[one.robot]) - 1
            for one in reports
        )
        missing = any(
            one.goal not in (-1, one.stop)
            or not set(ground_wanted(one)) <= set(plan.regions.get(one.robot, ()))
            for one in reports
        )
        return driven and missing and now - self._made_at > self._config.lease

    def _follow_newest(self, fresh: dict[str, Report]) -> None:
        """Becomes ready for the newest plan, and adopts it once all its robots are ready."""
        plans = [report.plan for report in (self._own, *fresh.values()) if report.plan is not None]
        newest = max(plans, key=lambda plan: plan.id, default=None)
        if newest is None or newest.id <= self._plan.id:
            return
        self._own = replace(self._own, ready=max(self._own.ready, newest.id))
        if self._own.robot not in newest.paths:
            if len(self._track) <= 1 and not self._own.out:
                self._leave_plan()
            return
        everyone = {**fresh, self._own.robot: self._own}
        if all(name in everyone and is_ready(everyone[name], newest) for name in newest.paths):
            self._adopt(newest)

    def _adopt(self, plan: Plan) -> None:
        self._plan = plan
        self._taken = 0
        self._waits_by_step = {}
        for wait in plan.waits:
            if wait.robot == self._own.robot:
                self._waits_by_step.setdefault(wait.step, []).append(wait)
        self._own = replace(self._own, adopted=plan.id)
        self._publish_held()

    def _take(self, fresh: dict[str, Report]) -> None:
        """Takes the next places of the path, unless another robot has to pass first or an outsider holds them."""
        path = self._plan.paths.get(self._own.robot, ())
        held = self._neighbours.held_outside(self._plan, fresh)
        while (
            self._taken + 1 < len(path)
            and len(self._track) <= self._config.horizon
            and not self._own.out
        ):
            index = self._taken + 1
            waits = self._waits(index)
            if path[index] in held or not all(
                self._has_left(*wait[2:], path[index]) for wait in waits
            ):
                return
            way = self._roadmap.places[path[index - 1]], self._roadmap.places[path[index]]
            if not self._is_way_free(*way):
                return
            self._taken = index
            self._track.append(path[index])
            self._publish_held()

    def _waits(self, step: int) -> list[Wait]:
        return self._waits_by_step.get(step, [])

    def _has_left(self, name: str, index: int, place: int) -> bool:
        other = self._neighbours.reports[name]
        return other.adopted == self._plan.id and (
            other.reached >= index or (index == 0 and place not in other.held)
        )

    def _finish_at_goal(self) -> None:
        """Notes that the waypoint is reached, if it is right at the goal's place, before a new plan leads elsewhere."""
        has_waypoint = self._waypoint is not None
        is_on_place = not self._own.region and not self._own.out
        if has_waypoint and is_on_place and self._own.has_arrived and self._is_at_place(0):
            self.finished = True

    def _may_leave(self, fresh: dict[str, Report]) -> bool:
        """Returns whether the plan grants the ground around the waypoint, and all who come by there have passed.

        Robots outside the plan may have claimed some of it since.
        """
        own, plan = self._own, self._plan
        has_waypoint = self._waypoint is not None and not self.finished
        if not has_waypoint or not own.region or own.out or not own.has_taken_goal:
            return False
        others = [self._neighbours.reports[name] for name in plan.paths if name != own.robot]
        free = all(
            other.adopted == plan.id and not comes_by(other, plan, own.region) for other in others
        )
        free = free and self._neighbours.held_outside(plan, fresh).isdisjoint(own.region)
        return free and set(own.region) <= set(plan.regions.get(own.robot, ()))

    def _leave(self) -> None:
        """Leaves the roadmap for the waypoint, once the robot has come to the goal's place, if it may."""
        if self._is_exit_free and self._own.has_arrived and self._is_at_place(0):
            self._visited, self._aside = self._waypoint, self._own.region
            self._own = replace(self._own, out=True)
            self._publish_held()

    def _farthest_onward(self, fresh: dict[str, Report]) -> Point | None:
        """Returns the farthest point of the path beyond the route that no other robot needs; None if there is none.

        The robot can head for it in a straight line that stays near the path: navigation then neither slows down at
        the end of the route, nor finds a different way.
        """
        if self._own.out or not self.route or self._waypoint is None:
            return None
        path = self._plan.paths[self._own.robot]
        needed = self._neighbours.needed(self._plan, fresh)
        places = self._roadmap.places
        points = [*self.route, *(places[place] for place in self._track_beyond_route())]
        count = len(self.route)
        for index in range(self._taken + 1, min(self._taken + 1 + self._config.horizon, len(path))):
            is_next = all(self._has_left(*wait[2:], path[index]) for wait in self._waits(index))
            if path[index] in needed or not is_next:
                break
            points.append(places[path[index]])
        else:
            if self._is_exit_free and points[-1] == places[path[-1]]:
                points.append(self._waypoint)
        ahead = (index for index in range(len(points) - 1, count - 1, -1))
        return next(
            (points[index] for index in ahead if self._leads_straight(points[: index + 1], needed)),
            None,
        )

    def _track_beyond_route(self) -> list[int]:
        """Returns the places taken since the route was made."""
        end = self.route[-1]
        positions = [self._roadmap.places[place] for place in self._track]
        return self._track[positions.index(end) + 1 :] if end in positions else []

    def _leads_straight(self, points: Sequence[Point], needed: Collection[int]) -> bool:
        """Returns whether the robot can drive straight to the last of these points, near all of them.

        It keeps clear of the places that others need, and of the ways that lead to these.
        """
        own, end = self._own.position, points[-1]
        if any(distance_to_segment(point, own, end) > _BAND for point in points):
            return False
        space = self._roadmap.space
        if space is not None and not space.sees(own, end, self._roadmap.config.driving_radius):
            return False
        if not self._is_way_free(own, end):
            return False
        return not needed or self._roadmap.near(own, end).isdisjoint(needed)

    def _visit(self) -> None:
        """Drives to the waypoint off the roadmap, and back once the waypoint changes."""
        if not self._own.out:
            return
        if self._visited == self._waypoint and self._visited is not None:
            self.route = (
                [self._visited] if self._is_way_free(self._own.position, self._visited) else []
            )
            self.finished = self.finished or self._is_near(self._visited)
        else:
            back = self._place(0)
            self.route = [back] if self._is_way_free(self._own.position, back) else []
            if self._is_near(self._place(0)):
                self._aside, self._own = (), replace(self._own, out=False)
                self._publish_held()
