"""Plans: which robot is led where, and over which ground."""

import random
from dataclasses import replace

import pytest

from pioneer_traffic.planning import planned
from pioneer_traffic.report import Plan, PlanId, Report
from pioneer_traffic.roadmap import Roadmap

COLS = 7
PLACES = [(float(col), float(row)) for row in range(2) for col in range(COLS)]
LADDER = Roadmap(
    PLACES,
    [
        [other for other, (u, v) in enumerate(PLACES) if abs(u - x) + abs(v - y) == 1.0]
        for x, y in PLACES
    ],
)
"""Two rows of seven places each, 0 … 6 and 7 … 13."""


def state(
    name: str, *held: int, goal: int = -1, region: tuple[int, ...] = (), out: bool = False
) -> Report:
    return Report(name, LADDER.signature, PLACES[held[-1]], held, goal, region=region, out=out)


def plan_for(*reports: Report, barred: tuple[int, ...] = ()) -> Plan:
    return planned(LADDER, reports, barred, PlanId(1, reports[0].robot))


def test_nobody_is_led_over_ground_that_a_robot_off_the_roadmap_uses() -> None:
    out = state("out", 3, 4, goal=4, region=(3,), out=True)
    asking = state("asking", 1, goal=1, region=(2,))
    plan = plan_for(out, asking, state("passing", 2, goal=6))
    assert 3 not in plan.paths["passing"]
    assert plan.paths["passing"][-1] == 6


def test_the_way_leads_round_places_that_are_barred() -> None:
    plan = plan_for(state("one", 0, goal=6), barred=(3,))
    assert 3 not in plan.paths["one"]
    assert plan.paths["one"][-1] == 6


def test_who_stands_near_a_robot_without_part_is_not_led_past_it() -> None:
    path = plan_for(state("one", 2, goal=6), barred=(2, 3)).paths["one"]
    assert path == (2, 9, 10, 11, 4, 5, 6) or set(path).isdisjoint({3})


def test_nobody_is_led_along_a_way_that_comes_too_near_to_a_robot_without_part() -> None:
    robot = state("a", 3, goal=10)
    plan = planned(LADDER, [robot], (3,), PlanId(1, "a"), {(3, 10)})
    assert plan.paths["a"] in [(3, 2, 9, 10), (3, 4, 11, 10)]


def test_of_two_robots_with_one_goal_the_one_that_has_waited_longest_gets_it() -> None:
    late = Report("a", LADDER.signature, PLACES[0], (0,), 3, since=5.0)
    early = Report("b", LADDER.signature, PLACES[6], (6,), 3, since=1.0)
    plan = plan_for(late, early)
    assert plan.paths["b"][-1] == 3
    assert plan.paths["a"][-1] != 3


def test_of_two_robots_with_one_goal_the_other_one_stays_on_its_side() -> None:
    """Both sides of the goal were equally near: the two changed sides at each plan, for ever."""
    there = Report("a", ROW.signature, ROW.places[3], (3,), 3, since=1.0)
    for at in (2, 4, 5):
        beside = Report("b", ROW.signature, ROW.places[at], (at,), 3, since=1.0)
        plan = planned(ROW, [there, beside], (), PlanId(1, "a"))
        assert plan.paths["a"] == (3,)
        assert plan.paths["b"][-1] == min(at, 4)


def test_a_robot_passes_two_that_it_has_to_send_through_the_only_bay() -> None:
    """The search gave up after 500 steps, and the robots stood until their goals were aborted."""
    long_row = [(float(col), 0.0) for col in range(13)]
    ways = [[other for other in (col - 1, col + 1) if 0 <= other < 13] for col in range(13)]
    ways[6].append(13)
    bay = Roadmap([*long_row, (6.0, 1.0)], [*ways, [6]])
    reports = [
        Report("first", bay.signature, bay.places[5], (5,), 12, since=1.0),
        Report("second", bay.signature, bay.places[8], (8,)),
        Report("third", bay.signature, bay.places[13], (13,)),
    ]
    plan = planned(bay, reports, (), PlanId(1, "first"))
    assert plan.paths["first"][-1] == 12


def test_an_idle_robot_makes_room_and_comes_back() -> None:
    row = Roadmap(
        [*PLACES[:COLS], (3.0, 1.0)], [[1], [0, 2], [1, 3], [2, 4, 7], [3, 5], [4, 6], [5], [3]]
    )
    idle, busy = (
        Report(n, row.signature, row.places[p], (p,), goal)
        for n, p, goal in (("a", 3, -1), ("b", 0, 6))
    )
    plan = planned(row, [idle, busy], (), PlanId(1, "a"))
    assert plan.paths["b"] == (0, 1, 2, 3, 4, 5, 6)
    assert len(plan.paths["a"]) > 1


def test_places_held_behind_a_robot_are_free_only_when_it_has_reached_its_first_place() -> None:
    plan = plan_for(state("front", 1, 2, goal=2), state("behind", 0, goal=1))
    assert ("behind", 1, "front", 0) in plan.waits


ROW = Roadmap(PLACES[:COLS], [[1], [0, 2], [1, 3], [2, 4], [3, 5], [4, 6], [5]])
BAY = Roadmap(
    [*PLACES[:COLS], (3.0, 1.0)], [[1], [0, 2], [1, 3], [2, 4, 7], [3, 5], [4, 6], [5], [3]]
)
"""A row of seven places, and the same row with one more place next to its middle."""


def test_a_younger_robot_is_led_where_the_oldest_one_cannot_be() -> None:
    """Fifteen robots in a corridor with bays deadlocked: only the older half was tried, down to the oldest alone."""
    first = Report("first", ROW.signature, ROW.places[0], (0,), 6, since=1.0)
    second = Report("second", ROW.signature, ROW.places[6], (6,), 1, since=2.0)
    plan = planned(ROW, [first, second], (), PlanId(1, "first"))
    assert plan.paths["second"][-1] == 1


def test_a_robot_makes_room_at_goals_of_robots_that_cannot_come() -> None:
    """No robot used to leave a region that another waited for, if all places around were goals of robots cut off."""
    asking = Report("asking", ROW.signature, ROW.places[3], (3,), 3, since=3.0, region=(4,))
    inside = Report("inside", ROW.signature, ROW.places[4], (4,), 2, since=4.0)
    outside = [
        Report(f"cut off {goal}", ROW.signature, ROW.places[6 - goal], (6 - goal,), goal)
        for goal in (5, 6)
    ]
    plan = planned(ROW, [asking, inside, *outside], (), PlanId(1, "asking"))
    assert plan.paths["inside"] == (4, 5)
    assert plan.regions["asking"] == (4,)


def test_a_robot_parked_behind_the_goal_of_another_is_led_past_it() -> None:
    """It used to be stuck in the region that had been granted to the other robot, which waited for it to leave."""
    parked = Report("parked", BAY.signature, BAY.places[7], (7,))
    for at in (3, 0):
        asking = Report("asking", BAY.signature, BAY.places[at], (at,), 3, region=(7,))
        plan = planned(BAY, [asking, parked], (), PlanId(1, "asking"))
        assert "asking" not in plan.regions
        assert plan.paths["parked"][-1] not in {3, 7}


def test_who_has_to_leave_a_region_does_not_wait_for_a_place_whose_robot_is_cut_off() -> None:
    """Fifteen robots used to deadlock: the way out also led to a pocket, whose robot was waiting itself."""
    places = [(0.0, 0.0), (1.0, 0.0), (0.5, 0.8), (2.0, 0.0), (3.0, 0.0)]
    pocket = Roadmap(places, [[1, 2], [0, 2, 3], [0, 1], [1, 4], [3]])
    asking = Report("asking", pocket.signature, places[0], (0,), 0, since=1.0, region=(1,))
    cut_off = Report("cut off", pocket.signature, places[2], (2,), 4, since=2.0)
    inside = Report("inside", pocket.signature, places[1], (1,), 1, since=3.0, region=(3,))
    plan = planned(pocket, [asking, cut_off, inside], (), PlanId(1, "asking"))
    assert plan.paths["inside"] == (1, 3)
    assert plan.regions == {"asking": (1,)}


def test_nobody_is_granted_a_region_whose_robot_could_leave_it_only_for_a_place_that_is_full() -> (
    None
):
    """All robots used to deadlock in a dead end: the last place counted as a way out with a cut-off robot on it."""
    asking = Report("asking", BAY.signature, BAY.places[2], (2,), 2, since=1.0, region=(1,))
    inside = Report("inside", BAY.signature, BAY.places[1], (1,), 5, since=2.0)
    cut_off = Report("cut off", BAY.signature, BAY.places[0], (0,), 6, since=3.0)
    plan = planned(BAY, [asking, inside, cut_off], (), PlanId(1, "asking"))
    assert plan.regions == {}
    assert plan.paths["inside"][-1] == 5


def test_a_robot_backs_off_where_those_it_pushes_have_no_room_to_let_it_pass() -> None:
    """Robots used to deadlock at a room where only the goal was free: a robot that had gone in could not come out."""
    places = [*PLACES[:COLS], (0.0, 1.0), (0.0, -1.0), (4.0, 1.0)]
    room = Roadmap(
        places, [[1, 7, 8], [0, 2], [1, 3], [2, 4], [3, 5, 9], [4, 6], [5], [0], [0], [4]]
    )
    coming = Report("coming", room.signature, room.places[2], (2,), 7, since=1.0)
    idle = [
        Report(name, room.signature, room.places[at], (at,))
        for name, at in (("front", 0), ("back", 8))
    ]
    plan = planned(room, [coming, *idle], (), PlanId(1, "back"))
    assert plan.paths["coming"][-1] == 7


def test_ground_in_which_another_robot_would_stay_is_not_granted() -> None:
    """A robot in a corner was sent around a ring that others filled: it stayed, and the plan counted as complete."""
    places = [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (2.0, 0.0), (3.0, 0.0), (3.0, 1.0), (2.0, -1.0)]
    places += [(float(x), 2.0) for x in range(4)]
    near = [
        [other for other, (u, v) in enumerate(places) if abs(u - x) + abs(v - y) == 1.0]
        for x, y in places
    ]
    ring = Roadmap(places, near)
    stops = {"a": 6, "b": 2, "c": 4, "corner": 0, "owner": 1}
    reports = [Report(name, ring.signature, places[at], (at,)) for name, at in stops.items()]
    reports[-1] = replace(reports[-1], goal=1, region=(0,))
    plan = planned(ring, reports, (), PlanId(1, "a"))
    if "owner" in plan.regions:
        assert plan.paths["corner"][-1] != 0
    else:
        assert plan.paths["owner"][-1] != 1 or plan.paths["corner"][-1] != 0


@pytest.mark.parametrize("seed", range(40))
def test_no_granted_ground_is_where_another_robot_stays(seed: int) -> None:
    generator = random.Random(seed)
    count = generator.randint(3, 11)
    at = generator.sample(range(2 * COLS), count)
    reports = []
    for number, place in enumerate(at):
        asks = generator.random() < 0.4
        region = tuple(LADDER.neighbours[place][: generator.randint(1, 2)]) if asks else ()
        goal = place if asks else generator.choice([-1, *range(2 * COLS)])
        reports.append(state(f"robot{number:02}", place, goal=goal, region=region))
    plan = planned(LADDER, reports, (), PlanId(seed + 1, "robot00"))
    ends = {name: path[-1] for name, path in plan.paths.items()}
    for name, region in plan.regions.items():
        assert not [other for other in ends if other != name and ends[other] in region]
