"""Coordinators among themselves: no place is held twice and everybody arrives, also when reports or robots get lost."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pioneer_traffic.core.coordinator import Coordinator
from pioneer_traffic.core.report import Report
from pioneer_traffic.core.roadmap import Roadmap
from pioneer_traffic.core.simulation import Trial


def lattice(drawing: list[str]) -> Roadmap:
    """A place for each dot, 1 m apart, joined to those beside it."""
    places = [(float(x), float(-y)) for y, line in enumerate(drawing) for x, cell in enumerate(line) if cell == "."]
    near = [[other for other, (u, v) in enumerate(places) if abs(u - x) + abs(v - y) == 1.0] for x, y in places]
    return Roadmap(places, near)


BAY = lattice(["      .      ", "............."])
ROOMS = lattice(["...   ...", ".........", "...   ...", " .     . ", "...   ...", ".........", "...   ..."])


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


def test_the_same_seed_gives_the_same_run() -> None:
    def driven() -> tuple[float, ...]:
        starts, goals = ROOMS.places[:4], ROOMS.places[-4:]
        return Trial(ROOMS, None, starts, [[goal] for goal in goals], loss=0.2, seed=3).run(200.0).finished

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


@pytest.mark.parametrize("waypoint", [(50.0, 50.0), (-9.0, 0.0)])
def test_a_waypoint_far_from_all_places_is_refused(waypoint: tuple[float, float]) -> None:
    assert not Coordinator("a", BAY).set_waypoint(waypoint, 0.0)
