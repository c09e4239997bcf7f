"""The fleet's plan: a path for each robot on the roadmap, and the order in which robots pass each place.

``core.pathfinding`` finds the paths in steps; robots keep the order at each place, not the steps (Hönig et al.,
"Persistent and robust execution of MAPF schedules in warehouses", RA-L 2019). A late robot delays only those behind
it.
"""

import math
import random
from collections import deque
from collections.abc import Collection, Iterator, Sequence
from itertools import chain, pairwise

from pioneer_traffic.pathfinding import Configuration, Graph, Problem, solve
from pioneer_traffic.report import Plan, PlanId, Report, Wait
from pioneer_traffic.roadmap import Roadmap, Way

_TRIES, _MOST, _GOOD = 4, 500, 1.6
"""Searches with different priorities, configurations tried in each, and moves per needed move that are good enough."""
_LAST_RESORT = 60_000
"""Steps of robots tried for one robot if there is no plan otherwise: 0.2 s."""


def planned(
    roadmap: Roadmap,
    reports: Sequence[Report],
    barred: Collection[int],
    plan_id: PlanId,
    closed_ways: Collection[Way] = (),
    denied: Collection[str] = (),
) -> Plan:
    """Returns a plan for robots of which no two hold the same place.

    If not all can be at their goals at once, those that have waited longest go first, and the others make room.

    Args:
        roadmap: the roadmap.
        reports: of the robots that take part.
        barred: places near robots that do not take part.
        plan_id: id of the new plan; its number seeds the search.
        closed_ways: ways, with their directions, that come too near to robots that do not take part.
        denied: robots that may not leave the roadmap by this plan.
    """
    ordered = sorted(reports, key=lambda report: (report.goal < 0, report.since, report.robot))
    asked = {
        report.robot: report
        for report in ordered
        if report.out or (report.has_taken_goal and report.region)
    }
    vacated = set[int]()
    for name in denied:
        vacated.update(asked.pop(name).region)
    while True:
        regions = _granted(asked.values(), barred)
        graph, closed = _open_graph(roadmap, ordered, regions, barred)
        for place, other in closed_ways:
            if other in graph[place]:
                graph[place].remove(other)
        shutting = _shutting_in(graph, closed, ordered, regions)
        if not shutting:
            break
        for name in shutting:
            # The robot inside the region has to pass the region's owner first.
            vacated.update(asked.pop(name).region)
    targets = _targets(roadmap, ordered, regions, closed, vacated)
    distances = [_distances(graph, target) for target in targets]
    reachable = {
        one.robot: target
        for one, target, steps in zip(ordered, targets, distances, strict=True)
        if steps[one.stop] < len(graph)
    }
    outside, inside = _by_side(ordered, regions, closed)
    taken = closed.union(reachable[one.robot] for one in outside if one.robot in reachable)
    # A robot that has to get out of a region, and cannot go to its goal, takes the place that it can reach soonest.
    wanted = {one.robot: one.goal for one in inside if reachable.get(one.robot, -1) == one.goal}
    room = _room_for(
        graph, [one for one in outside if one.robot not in reachable] + inside, taken, wanted
    )
    for one in inside:
        # It stands in another robot's region, and may not reach its own goal now.
        robot = ordered.index(one)
        targets[robot] = room.get(one.robot, one.stop)
        distances[robot] = _distances(graph, targets[robot])
    tracks = _search(
        graph, tuple(report.stop for report in ordered), targets, distances, plan_id.number
    )
    ends = {track[-1] for track in tracks}
    blocked = {
        report.robot
        for report in ordered
        if not report.out and not ends.isdisjoint(regions.get(report.robot, ()))
    }
    if blocked:
        # Another robot would stay in the region: its owner could not use it, and lets the others pass first.
        denied = {*denied, *blocked}
        return planned(roadmap, reports, barred, plan_id, closed_ways, denied)
    visits = [list(_visits(places)) for places in tracks]
    names = [report.robot for report in ordered]
    return Plan(
        plan_id,
        {report.robot: report.held for report in ordered},
        {name: tuple(place for _, place in visits[robot]) for robot, name in enumerate(names)},
        {name: tuple(sorted(region)) for name, region in regions.items()},
        tuple(_waits(ordered, visits)),
    )


def _open_graph(
    roadmap: Roadmap,
    ordered: Sequence[Report],
    regions: dict[str, frozenset[int]],
    barred: Collection[int],
) -> tuple[list[list[int]], frozenset[int]]:
    """Returns the graph that is open while ``regions`` are granted, and the places that no robot may enter."""
    stops = {report.stop for report in ordered if report.robot in regions}
    closed = stops.union(barred, *regions.values())
    # A robot in a region that is granted but not yet used may leave through such regions: their owners wait for that
    # (``Coordinator``).
    used = stops.union(barred, *(regions[report.robot] for report in ordered if report.out))
    graph = [
        []
        if place in stops
        else [other for other in near if other not in (used if place in closed else closed)]
        for place, near in enumerate(roadmap.neighbours)
    ]
    return graph, frozenset(closed)


def _granted(asked: Collection[Report], barred: Collection[int]) -> dict[str, frozenset[int]]:
    """Returns the regions, by robot, of those asking robots that may leave the roadmap at their goals now."""
    claimed, granted = set(barred), dict[str, frozenset[int]]()
    for report in sorted(asked, key=lambda report: not report.out):
        own = set(report.held) if report.out else {*report.region, report.stop}
        if report.out or not claimed & own:
            granted[report.robot] = frozenset(own - {report.stop})
            claimed |= own
    return granted


def _shutting_in(
    graph: Graph,
    closed: Collection[int],
    ordered: Sequence[Report],
    regions: dict[str, frozenset[int]],
) -> list[str]:
    """Returns the region owners, still on the roadmap, in whose region another robot stands that has nowhere to go."""
    owners = [report for report in ordered if report.robot in regions and not report.out]
    outside, inside = _by_side(ordered, regions, closed)
    room = _room_for(graph, outside + inside, closed, {})
    shut_in = {report.stop for report in inside if report.robot not in room}
    return [report.robot for report in owners if shut_in & regions[report.robot]]


def _by_side(
    ordered: Sequence[Report], regions: dict[str, frozenset[int]], closed: Collection[int]
) -> tuple[list[Report], list[Report]]:
    """Returns the robots without a region: those at places open to all, and those that have to get out of a region."""
    others = [report for report in ordered if report.robot not in regions]
    outside = [report for report in others if report.stop not in closed]
    return outside, [report for report in others if report.stop in closed]


def _room_for(
    graph: Graph, robots: Sequence[Report], taken: Collection[int], wanted: dict[str, int]
) -> dict[str, int]:
    """Returns a different place for each robot: the wanted one or one nearby; leaves out robots without room.

    A robot gives its place to another if it can reach one further away (maximum matching, Kuhn 1955).
    """
    owners = dict[int, Report]()

    def finds_room(report: Report, tried: set[int]) -> bool:
        for place in chain([wanted.get(report.robot, report.stop)], _around(graph, report.stop)):
            if place in taken or place in tried:
                continue
            tried.add(place)
            if place not in owners or finds_room(owners[place], tried):
                owners[place] = report
                return True
        return False

    for report in robots:
        finds_room(report, set())
    return {report.robot: place for place, report in owners.items()}


def _targets(
    roadmap: Roadmap,
    ordered: Sequence[Report],
    regions: dict[str, frozenset[int]],
    closed: Collection[int],
    vacated: Collection[int],
) -> list[int]:
    """Returns a different place for each robot: its goal, or the nearest free place that is not ``vacated``.

    No robot may stay in, or go to, places that an older robot will shut in at its goal.
    """
    taken, shunned, targets = set(closed), set(vacated), []
    for report in ordered:
        target = report.stop
        if report.robot not in regions:
            wanted = report.goal if report.goal >= 0 else report.stop
            target = _nearest_free(roadmap.neighbours, wanted, taken | shunned, report.stop)
            taken.add(target)
            shunned |= _pocket(roadmap, report)
        targets.append(target)
    return targets


def _pocket(roadmap: Roadmap, report: Report) -> set[int]:
    """Returns the places that are cut off while the robot uses its goal and the region around it."""
    inside = {place for place in report.region if 0 <= place < len(roadmap.places)}
    outside = [
        place
        for place in inside
        if not inside.issuperset({*roadmap.neighbours[place]} - {report.goal})
    ]
    while outside:
        place = outside.pop()
        inside.discard(place)
        outside.extend(inside.intersection(roadmap.neighbours[place]))
    return inside


def _nearest_free(graph: Graph, wanted: int, taken: Collection[int], stop: int) -> int:
    """Returns the free place nearest to ``wanted``; of several, the one nearest to the robot's stop.

    Otherwise two robots that want one place changed sides at each plan, for ever.
    """
    nearest: list[int] = []
    least = len(graph)
    for place, steps in _around_by_steps(graph, wanted):
        if steps > least:
            break
        if place not in taken:
            nearest.append(place)
            least = steps
    if not nearest or stop in nearest:
        return stop
    if len(nearest) == 1:
        return nearest[0]
    return next((place for place in _around(graph, stop) if place in nearest), nearest[0])


def _around(graph: Graph, start: int) -> Iterator[int]:
    """Yields the places reachable from ``start``, the nearest first."""
    return (place for place, _ in _around_by_steps(graph, start))


def _around_by_steps(graph: Graph, start: int) -> Iterator[tuple[int, int]]:
    """Yields the places reachable from ``start``, the nearest first, each with its number of steps."""
    known, waiting = {start}, deque([(start, 0)])
    while waiting:
        place, steps = waiting.popleft()
        yield place, steps
        fresh = [other for other in graph[place] if other not in known]
        known.update(fresh)
        waiting.extend((other, steps + 1) for other in fresh)


def _distances(graph: Graph, goal: int) -> list[int]:
    """Returns the number of steps from each place to ``goal``, in a graph whose ways may be one-way."""
    before: list[list[int]] = [[] for _ in graph]
    for place, near in enumerate(graph):
        for other in near:
            before[other].append(place)
    return Roadmap([(0.0, 0.0)] * len(graph), before).distances(goal)


def _search(
    graph: Graph,
    starts: Configuration,
    targets: Sequence[int],
    distances: Sequence[Sequence[int]],
    seed: int,
) -> list[list[int]]:
    """Returns each robot's place by step; leads as many robots to their targets as pays off, oldest first.

    A plan is better the fewer steps all robots take per step that the led robots need. If not even the oldest can be
    led, adds robots one by one, each only while those before it can still be led.
    """
    reachable = [
        distance[start] < len(graph) for start, distance in zip(starts, distances, strict=True)
    ]
    waiting = [
        robot for robot, start in enumerate(starts) if reachable[robot] and targets[robot] != start
    ]
    guides = [
        distance if fine else [0] * len(graph)
        for distance, fine in zip(distances, reachable, strict=True)
    ]

    def led_by(led: Sequence[int], attempt: int, most: int = _MOST) -> list[list[int]] | None:
        goals = [target if robot in led else None for robot, target in enumerate(targets)]
        order = list(range(len(starts)))
        if attempt:
            random.Random(seed + attempt).shuffle(order)
        found = solve(Problem(graph, starts, guides, goals), order, seed + attempt, most)
        return None if found is None else _without_detours(found)

    best, least = [[start] for start in starts], math.inf
    led = waiting
    while led and least > _GOOD:
        needed = sum(distances[robot][starts[robot]] for robot in led)
        for attempt in range(_TRIES):
            tracks = led_by(led, attempt)
            if tracks is None:
                continue
            moves = sum(one != other for track in tracks for one, other in pairwise(track))
            if moves / needed < least:
                best, least = tracks, moves / needed
            if least <= _GOOD:
                break
        led = led[: len(led) // 2]
    if least == math.inf:
        for robot in waiting[1:]:
            tracks = led_by([*led, robot], 0)
            if tracks is not None:
                best, led = tracks, [*led, robot]
    if least == math.inf and not led:
        led_past = (_led_past(graph, starts, targets, guides, robot, seed) for robot in waiting)
        thorough = (led_by([robot], 0, _LAST_RESORT // len(starts)) for robot in waiting[:1])
        found = (tracks for tracks in chain(led_past, thorough) if tracks is not None)
        best = next(found, best)
    return best


def _led_past(
    graph: Graph,
    starts: Configuration,
    targets: Sequence[int],
    guides: Sequence[Sequence[int]],
    led: int,
    seed: int,
) -> list[list[int]] | None:
    """Returns each robot's place by step; one robot is led to its target after one in its way has moved aside.

    For a robot that would otherwise push others to where they cannot be passed. Returns None if no try succeeds.
    """
    occupant = {start: robot for robot, start in enumerate(starts)}
    generator, place, ahead = random.Random(seed), starts[led], list[int]()
    while place != targets[led]:
        place = min(graph[place], key=guides[led].__getitem__)
        if place in occupant:
            ahead.append(occupant[place])
    for robot in generator.choices(ahead, k=_TRIES) if ahead else ():
        free = [
            place for place in _around(graph, starts[robot]) if place not in {*starts, *targets}
        ]
        if not free:
            continue
        aside = generator.choice(free[: 2 * len(starts)])
        goals: list[int | None] = [None] * len(starts)
        goals[led], goals[robot] = targets[led], aside
        changed = [*guides]
        changed[robot] = _distances(graph, aside)
        order = sorted(range(len(starts)), key=lambda one: one != robot)
        tracks = solve(Problem(graph, starts, changed, goals), order, seed, _MOST)
        if tracks is not None:
            return _without_detours(tracks)
    return None


def _without_detours(steps: Sequence[Configuration]) -> list[list[int]]:
    """Returns each robot's places by step; a robot waits instead of leaving and returning if its place stays unused."""
    tracks = [list(track) for track in zip(*steps, strict=True)]
    for robot, track in enumerate(tracks):
        step = 0
        while step < len(track):
            place = track[step]
            last = max(later for later in range(step, len(track)) if track[later] == place)
            others = (other for number, other in enumerate(tracks) if number != robot)
            if last > step + 1 and not any(place in other[step : last + 1] for other in others):
                track[step:last] = [place] * (last - step)
                step = last
            step += 1
    return tracks


def _visits(places: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Yields (step, place) for each change of a robot's place, including the first."""
    for step, place in enumerate(places):
        if step == 0 or place != places[step - 1]:
            yield step, place


def _waits(
    ordered: Sequence[Report], visits: Sequence[Sequence[tuple[int, int]]]
) -> Iterator[Wait]:
    """Yields, for each visit of a place, which robot must have left it before."""
    by_place: dict[int, list[tuple[int, int, int]]] = {}
    for robot, own in enumerate(visits):
        for index, (step, place) in enumerate(own):
            by_place.setdefault(place, []).append((step, robot, index))
    for robot, report in enumerate(ordered):
        # The places held behind it become free once it has reached its first place.
        for place in set(report.held[:-1]):
            by_place.setdefault(place, []).append((-1, robot, -1))
    for entries in by_place.values():
        entries.sort()
        for (_, before, left), (_, after, index) in pairwise(entries):
            if before != after:
                yield Wait(ordered[after].robot, index, ordered[before].robot, left + 1)
