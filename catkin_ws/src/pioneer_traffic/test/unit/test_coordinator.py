"""Coordinators together: no place is held twice and all robots arrive, even if reports or robots are lost."""

import math
import random
from dataclasses import replace

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pioneer_traffic.coordinator import Coordinator
from pioneer_traffic.report import Plan, PlanId, Report
from pioneer_traffic.roadmap import Roadmap
from pioneer_traffic.simulation import TICK, Trial


def lattice(drawing: list[str]) -> Roadmap:
    """Returns a roadmap with one place per dot, 1 m apart, joined to its neighbours."""
    places = [
        (float(x), float(-y))
        for y, line in enumerate(drawing)
        for x, cell in enumerate(line)
        if cell == "."
    ]
    near = [
        [other for other, (u, v) in enumerate(places) if abs(u - x) + abs(v - y) == 1.0]
        for x, y in places
    ]
    return Roadmap(places, near)


ROW = lattice(["......."])
BAY = lattice(["      .      ", "............."])
CORRIDOR = lattice(["    .    ", "........."])
ROOMS = lattice(
    ["...   ...", ".........", "...   ...", " .     . ", "...   ...", ".........", "...   ..."]
)


def test_two_robots_swap_ends_by_way_of_the_bay() -> None:
    left, right = BAY.places[1], BAY.places[-1]
    outcome = Trial(BAY, None, [left, right], [[right], [left]]).run(90.0)
    assert (outcome.reached, outcome.contacts, outcome.shared) == (2, 0, False)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10**6), robots=st.integers(2, 8), loss=st.sampled_from([0.0, 0.3]))
def test_no_place_is_held_twice_and_everybody_arrives(seed: int, robots: int, loss: float) -> None:
    generator = random.Random(seed)
    starts = generator.sample(ROOMS.places, robots)
    tours = [generator.sample(ROOMS.places, 2) for _ in range(robots)]
    outcome = Trial(ROOMS, None, starts, tours, loss=loss, seed=seed).run(600.0)
    assert not outcome.shared
    assert outcome.contacts == 0
    assert outcome.reached == outcome.asked


def test_the_others_go_round_a_robot_that_is_gone() -> None:
    trial = Trial(ROOMS, None, [ROOMS.places[7], ROOMS.places[5]], [[], [ROOMS.places[0]]])
    trial.run(3.0)
    trial.present[0] = False
    outcome = trial.run(60.0)
    assert outcome.finished[1] < 60.0
    assert outcome.contacts == 0


def test_the_robot_that_makes_the_plans_may_go_and_come_back() -> None:
    tours = [[ROOMS.places[-1], ROOMS.places[0]], [ROOMS.places[0], ROOMS.places[-1]]]
    trial = Trial(ROOMS, None, [ROOMS.places[0], ROOMS.places[-1]], tours)
    trial.run(4.0)
    trial.present[0] = False
    trial.run(12.0)
    trial.present[0] = True
    outcome = trial.run(200.0)
    assert (outcome.reached, outcome.contacts, outcome.shared) == (4, 0, False)


@settings(max_examples=6, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    robots=st.integers(2, 6),
    absence=st.sampled_from([1.0, 3.0, 30.0, 200.0]),
)
@example(seed=5, robots=6, absence=200.0)
def test_a_robot_may_go_at_any_time_and_come_back(seed: int, robots: int, absence: float) -> None:
    generator = random.Random(seed)
    tours = [generator.sample(ROOMS.places, 2) for _ in range(robots)]
    trial = Trial(ROOMS, None, generator.sample(ROOMS.places, robots), tours, loss=0.2, seed=seed)
    gone, since = generator.randrange(robots), generator.uniform(0.0, 40.0)
    trial.run(since)
    trial.present[gone] = False
    trial.run(since + absence)
    trial.present[gone] = True
    outcome = trial.run(1500.0)
    assert (outcome.reached, outcome.contacts, outcome.shared) == (outcome.asked, 0, False)


@pytest.mark.parametrize("cut_at", [3.0, 3.5, 4.0, 4.5, 5.0, 6.0])
def test_a_robot_that_is_not_heard_but_hears_is_not_driven_into(cut_at: float) -> None:
    """It continues by the plan until it hears that it is lost; the other robot took the same places meanwhile."""
    left, right = CORRIDOR.places[1], CORRIDOR.places[-1]
    trial = Trial(CORRIDOR, None, [left, right], [[right], []])
    trial.run(cut_at)
    trial.cut = {(1, 0)}
    outcome = trial.run(cut_at + 40.0)
    assert (outcome.contacts, outcome.shared) == (0, False)
    trial.cut = set()
    outcome = trial.run(cut_at + 140.0)
    assert (outcome.reached, outcome.contacts, outcome.shared) == (1, 0, False)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10**6), robots=st.integers(2, 5))
@example(seed=106, robots=3)
def test_robots_without_goals_may_stop_to_be_heard_at_any_time(seed: int, robots: int) -> None:
    """They make way and hear the others; of those with goals, no other robot could know where they drive."""
    generator = random.Random(seed)
    order = generator.sample(range(robots), robots)
    idle = order[: generator.randint(1, robots - 1)]
    tours = [[] if one in idle else generator.sample(ROOMS.places, 2) for one in range(robots)]
    trial = Trial(ROOMS, None, generator.sample(ROOMS.places, robots), tours, loss=0.1, seed=seed)
    for _ in range(8):
        trial.run(trial.time + generator.uniform(0.0, 10.0))
        sender = generator.choice(idle)
        receiver = generator.choice([one for one in range(robots) if one != sender])
        trial.cut ^= {(sender, receiver)}
        trial.cut -= {(receiver, sender)}
    trial.cut = set()
    outcome = trial.run(1500.0)
    assert (outcome.reached, outcome.contacts, outcome.shared) == (outcome.asked, 0, False)


def test_a_goal_is_reached_even_if_the_next_plan_is_made_at_that_moment() -> None:
    """The robot that makes the plans led itself away from a goal that it had just reached, again and again."""
    trial = Trial(ROW, None, [ROW.places[0], ROW.places[2]], [[ROW.places[3]], [ROW.places[3]]])
    outcome = trial.run(120.0)
    assert outcome.contacts == 0
    assert min(outcome.finished) < 30.0


def test_a_robot_carried_into_the_way_of_another_is_not_driven_into() -> None:
    """Only what a robot held used to count, not where it was: the other drove on into it."""
    trial = Trial(ROW, None, [ROW.places[0], (0.0, 9.0)], [[ROW.places[6]], []])
    trial.run(4.0)
    ahead = ROW.places[4]
    assert math.dist(trial.bodies[0].position, ahead) > 1.8
    trial.carry(1, ahead)
    trial.bodies[1].drive = lambda route: None  # type: ignore[method-assign]
    outcome = trial.run(30.0)
    assert (outcome.reached, outcome.contacts) == (0, 0)
    trial.carry(1, (0.0, 9.0))
    assert trial.run(60.0).reached == 1


def test_a_robot_beside_one_without_part_is_led_by_a_way_that_it_drives() -> None:
    """The plan used to lead it past the other one, which it refused for ever, and all robots behind it waited."""
    ladder = lattice([".......", "......."])
    trial = Trial(ladder, None, [(3.0, 0.0), (3.62, -0.35)], [[(3.0, -1.0)], []])
    trial.coordinators[1].hold()
    trial.bodies[1].drive = lambda route: None  # type: ignore[method-assign]
    assert trial.run(40.0).reached == 1


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10**6), robots=st.integers(2, 6))
def test_robots_may_be_carried_elsewhere_at_any_time(seed: int, robots: int) -> None:
    generator = random.Random(seed)
    tours = [generator.sample(ROOMS.places, 2) for _ in range(robots)]
    trial = Trial(ROOMS, None, generator.sample(ROOMS.places, robots), tours, loss=0.1, seed=seed)
    for _ in range(4):
        trial.run(trial.time + generator.uniform(0.0, 15.0))
        carried = generator.randrange(robots)
        x, y = generator.choice(ROOMS.places)
        point = (x + generator.uniform(-0.5, 0.5), y + generator.uniform(-0.5, 0.5))
        others = (body for index, body in enumerate(trial.bodies) if index != carried)
        if all(math.dist(body.position, point) > 1.8 for body in others):
            trial.carry(carried, point)
    outcome = trial.run(1500.0)
    assert (outcome.reached, outcome.contacts) == (outcome.asked, 0)


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("since", [6.0, 12.0, 18.0])
def test_a_robot_that_is_held_up_delays_others_and_nothing_else(late: int, since: float) -> None:
    left, right = BAY.places[1], BAY.places[-1]
    trial = Trial(BAY, None, [left, right], [[right], [left]])
    trial.run(since)
    body = trial.bodies[late]
    body.drive = lambda route: None  # type: ignore[method-assign]
    assert math.isinf(trial.run(since + 40.0).finished[late])
    del body.drive
    outcome = trial.run(since + 110.0)
    assert (outcome.reached, outcome.contacts, outcome.shared) == (2, 0, False)


def test_a_plan_stays_while_it_leads_a_robot_off_its_goal() -> None:
    """Robots used to deadlock: as soon as the robot had made way, a new plan no longer let the others pass."""
    one = Coordinator("a", ROW)

    def plan_number(begin: float, *held: int) -> int:
        for tick in range(15):
            now = begin + 0.2 * tick
            one.receive(
                Report("b", ROW.signature, ROW.places[4], held, 4, region=(5,), heard=("a",)), now
            )
            report = one.advance(ROW.places[0], now)
        return report.plan.id.number if report.plan else 0

    made = plan_number(0.0, 4)
    assert made > 0
    assert plan_number(3.0, 4, 3) == made
    assert plan_number(6.0, 4) > made


def test_who_comes_back_hears_all_others_before_it_makes_a_plan() -> None:
    one = Coordinator("a", ROW)

    def advance(begin: float, names: str) -> frozenset[str]:
        for tick in range(15):
            now = begin + 0.2 * tick
            for name in names:
                place = {"b": 3, "c": 6}[name]
                heard = tuple({"a", *names} - {name})
                one.receive(
                    Report(name, ROW.signature, ROW.places[place], held=(place,), heard=heard), now
                )
            report = one.advance(ROW.places[0], now)
        return frozenset(report.plan.paths if report.plan else ())

    assert advance(0.0, "bc") == {"a", "b", "c"}
    one.receive(Report("b", ROW.signature, ROW.places[3], held=(3,), heard=("a",)), 100.0)
    report = one.advance(ROW.places[0], 100.0)
    assert report.plan is not None
    assert set(report.plan.paths) == {"a", "b", "c"}
    assert advance(100.2, "b") == {"a", "b"}


@pytest.mark.parametrize("claimed", [(), (3,)])
def test_a_robot_leaves_the_roadmap_only_when_nobody_comes_by_or_has_claimed_the_ground(
    claimed: tuple[int, ...],
) -> None:
    """It used to drive over ground that a robot without a plan, starting there, had claimed in the meantime."""
    waypoint = (2.5, 0.0)
    leaver = Coordinator("z", ROW)
    assert leaver.set_waypoint(waypoint, 0.0)
    leaver.advance(ROW.places[2], 0.0)
    plan = Plan(
        PlanId(5, "a"),
        {"a": (0,), "b": (4,), "z": leaver.report.held},
        {"a": (0,), "b": (4, 3, 4), "z": (2,)},
        {"z": leaver.report.region},
    )
    assert 3 in leaver.report.region

    def is_out(reached: int, now: float) -> bool:
        for name, place, at in (("a", 0, 0), ("b", 4, reached)):
            heard = tuple({"a", "b", "z"} - {name})
            state = Report(
                name,
                ROW.signature,
                ROW.places[place],
                (place,),
                adopted=plan.id,
                ready=plan.id,
                reached=at,
            )
            leaver.receive(replace(state, heard=heard, plan=plan if name == "a" else None), now)
        return leaver.advance(ROW.places[2], now).out

    assert not any(is_out(0, 0.2 * tick) for tick in range(1, 6))
    leaver.receive(Report("c", ROW.signature, (3.0, 1.0), claimed), 1.3)
    assert is_out(2, 1.4) != bool(claimed)
    leaver.receive(Report("c", ROW.signature, (3.0, 1.0)), 1.5)
    assert is_out(2, 1.6)
    assert leaver.route == [waypoint]


def test_a_robot_that_cuts_the_first_corner_lets_go_of_the_ground_it_started_on() -> None:
    one = Coordinator("a", ROW)
    one.set_waypoint(ROW.places[-1], 0.0)
    for tick in range(20):
        one.advance((0.0, 0.9), 0.2 * tick)
    assert one.route == ROW.places[:4]
    assert one.advance((2.9, 0.1), 4.0).held == (3, 4, 5, 6)


def test_a_robot_that_cuts_a_corner_lets_go_of_what_it_keeps_clear_of() -> None:
    """It kept the places of a corner that it had cut, slowed down at the end of what it held, and stopped."""
    corner = Roadmap(
        [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (2.0, 2.0), (2.0, 3.0), (1.0, -1.0)],
        [[1], [0, 2, 6], [1, 3], [2, 4], [3, 5], [4], [1]],
    )
    one = Coordinator("a", corner)
    one.set_waypoint(corner.places[5], 0.0)
    for tick in range(20):
        one.advance(corner.places[0], 0.2 * tick)
    assert one.report.held == (0, 1, 2, 3)
    assert one.advance((0.7, 0.35), 4.0).held == (0, 1, 2, 3), "another robot may come to 0"
    assert one.advance((1.3, 0.75), 4.2).held == (1, 2, 3, 4)
    assert one.advance((1.5, 0.6), 4.4).held == (1, 2, 3, 4), "another robot may come to 1 from 6"
    assert one.advance((1.6, 0.8), 4.6).held == (2, 3, 4, 5)


def test_a_robot_off_the_roadmap_does_not_return_to_its_place_before_the_next_way() -> None:
    """It drove back to the place at each waypoint, and two plans were made one after the other."""
    trial = Trial(ROW, None, [ROW.places[2]], [[(2.0, 0.55), ROW.places[6]]])
    (one,) = trial.coordinators
    while trial._reached[0] == 0:
        trial.step()
    ground = set(one.report.held)
    assert not one.report.out
    assert len(ground) > 1
    number = one.report.ready.number
    while one.report.stop == 2:
        trial.step()
        assert set(one.report.held) >= ground
    assert one.report.ready.number == number + 1
    assert trial.bodies[0].y > 0.3
    assert trial.run(60.0).reached == 2


def test_a_robot_alone_heads_beyond_what_it_holds_and_at_the_end_for_its_waypoint() -> None:
    """It slowed down before each place at the end of what it held, and stopped at the last one."""
    one = Coordinator("a", ROW)
    waypoint = (6.0, 0.4)
    one.set_waypoint(waypoint, 0.0)
    x, headed = 0.0, []
    for tick in range(200):
        one.advance((x, 0.0), 0.2 * tick)
        if one.onward is not None:
            headed.append(one.onward)
            assert one.onward[0] - x > 1.5 or one.onward == waypoint
        if one.route and x < 5.8:
            x += 0.1
    assert headed[0] == ROW.places[6]
    assert headed[-1] == waypoint
    assert one.report.out
    assert one.route == [waypoint]


@pytest.mark.parametrize("seed", range(12))
def test_what_robots_head_for_beyond_what_they_hold_is_needed_by_no_other(seed: int) -> None:
    generator = random.Random(seed)
    count = generator.randint(2, 6)
    starts = generator.sample(ROOMS.places, count)
    tours = [generator.sample(ROOMS.places, 3) for _ in starts]
    trial = Trial(ROOMS, None, starts, tours, seed=seed)
    seen = 0
    while trial.time < 60.0:
        trial.step()
        for index, one in enumerate(trial.coordinators):
            has_advanced = (trial._steps + index) % TICK == 0
            if one.onward is None or not has_advanced:
                continue
            seen += 1
            ground = ROOMS.near(one.report.position, one.onward)
            for other in trial.coordinators:
                report = other.report
                if other is not one and report.adopted == one.report.adopted:
                    path = other._plan.paths[report.robot]
                    assert ground.isdisjoint({*report.held, *path[max(0, report.reached) :]})
    assert seen > 0


def test_one_waypoint_after_the_other_is_reached_from_one_place() -> None:
    outcome = Trial(ROW, None, [ROW.places[0]], [[(2.0, 0.45), (2.0, -0.45), (2.0, 0.45)]]).run(
        60.0
    )
    assert outcome.reached == 3


def test_the_same_seed_gives_the_same_run() -> None:
    def driven() -> tuple[float, ...]:
        starts, goals = ROOMS.places[:4], ROOMS.places[-4:]
        return (
            Trial(ROOMS, None, starts, [[goal] for goal in goals], loss=0.2, seed=3)
            .run(200.0)
            .finished
        )

    assert driven() == driven()


def test_a_robot_without_any_plan_stays() -> None:
    alone = Coordinator("a", BAY, expected=["b"])
    alone.set_waypoint(BAY.places[-1], 0.0)
    for tick in range(50):
        alone.advance(BAY.places[1], 0.2 * tick)
    assert alone.route == []


def test_a_robot_that_sends_no_reports_is_driven_round() -> None:
    one = Coordinator("a", ROOMS)
    one.set_obstacles([ROOMS.places[1]])
    one.set_waypoint(ROOMS.places[2], 0.0)
    for tick in range(30):
        report = one.advance(ROOMS.places[0], 0.2 * tick)
    assert report.plan is not None
    assert 1 not in report.plan.paths["a"]
    assert report.plan.paths["a"][-1] == 2


def test_robots_with_another_roadmap_take_no_part() -> None:
    one = Coordinator("b", BAY)
    one.receive(Report("a", BAY.signature + 1, BAY.places[3], held=(3,)), 0.0)
    for tick in range(30):
        report = one.advance(BAY.places[0], 0.2 * tick)
    assert report.plan is not None
    assert set(report.plan.paths) == {"b"}


def test_a_robot_silent_for_minutes_is_forgotten() -> None:
    """A robot that was removed used to block its place for ever."""
    one = Coordinator("a", ROW)
    one.receive(Report("b", ROW.signature, ROW.places[3], held=(3,), heard=("a",)), 0.0)
    one.set_waypoint(ROW.places[6], 0.0)

    def path_at(begin: float) -> tuple[int, ...]:
        for tick in range(30):
            report = one.advance(ROW.places[0], begin + 0.2 * tick)
        return report.plan.paths["a"] if report.plan else ()

    assert 3 not in path_at(20.0)
    assert path_at(301.0)[-1] == 6


def test_plans_continue_after_the_clock_jumped_back() -> None:
    """In lockstep a new plan used to come only once the clock had passed the time before the jump."""
    one = Coordinator("a", ROW)

    def plan_at(begin: float, goal: int) -> tuple[int, ...]:
        one.set_waypoint(ROW.places[goal], begin)
        for tick in range(20):
            now = begin + 0.2 * tick
            one.receive(
                Report(
                    "b", ROW.signature, ROW.places[6], (6,), heard=("a",), ready=one.report.ready
                ),
                now,
            )
            report = one.advance(ROW.places[0], now)
        return report.plan.paths["a"] if report.plan else ()

    assert plan_at(1000.0, 2)[-1] == 2
    assert plan_at(3.0, 4)[-1] == 4


def test_a_robot_that_does_not_hear_this_one_is_driven_around() -> None:
    """The robot that heard the other used to wait for it for ever."""
    one = Coordinator("a", ROOMS)
    one.set_waypoint(ROOMS.places[2], 0.0)
    for tick in range(40):
        now = 0.2 * tick
        one.receive(Report("b", ROOMS.signature, ROOMS.places[1], held=(1,), heard=("c",)), now)
        report = one.advance(ROOMS.places[0], now)
    assert report.plan is not None
    assert report.plan.paths.keys() == {"a"}
    assert report.adopted == report.plan.id
    assert 1 not in report.plan.paths["a"]


@pytest.mark.parametrize("waypoint", [(50.0, 50.0), (-9.0, 0.0)])
def test_a_waypoint_far_from_all_places_is_refused(waypoint: tuple[float, float]) -> None:
    assert not Coordinator("a", BAY).set_waypoint(waypoint, 0.0)


@pytest.mark.parametrize("stands", [2, 3, 4])
def test_a_robot_in_the_plan_that_is_away_from_what_it_holds_is_not_driven_into(
    stands: int,
) -> None:
    """Its report names places that it holds, and a position where it should not be: both count."""
    driving, other = Coordinator("a", ROW, expected=["b"]), Coordinator("b", ROW, expected=["a"])
    driving.set_waypoint(ROW.places[5], 0.0)
    position, end, away = ROW.places[0], ROW.places[6], ROW.places[stands]
    nearest = math.inf
    for tick in range(200):
        now = 0.2 * tick
        report = driving.advance(position, now)
        other.receive(report, now)
        held = other.advance(end, now)
        assert now < 4.0 or held.held == (6,)
        driving.receive(replace(held, position=away) if now > 4.0 else held, now)
        if driving.route:
            distance = math.dist(position, driving.route[0])
            share = min(1.0, 0.1 / distance) if distance else 0.0
            x, y = position
            position = (
                x + share * (driving.route[0][0] - x),
                y + share * (driving.route[0][1] - y),
            )
        if now > 5.0:
            nearest = min(nearest, math.dist(position, away))
    assert "b" in report.heard
    assert nearest >= ROW.config.clearance - 0.1
    assert math.dist(position, ROW.places[0]) > 0.1
