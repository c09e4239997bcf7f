"""Paths for many robots: safe in every step, found on random graphs, and correct in narrow corridors."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pioneer_traffic.pathfinding import Problem, solve
from pioneer_traffic.roadmap import Roadmap


def graph_of(places: int, ways: list[tuple[int, int]]) -> list[list[int]]:
    found: list[set[int]] = [set() for _ in range(places)]
    for one, other in ways:
        found[one].add(other)
        found[other].add(one)
    return [sorted(near) for near in found]


def corridor(length: int, bays: list[int]) -> list[list[int]]:
    """Returns places 0 … length - 1 in a row, with a bay next to each place in ``bays``."""
    row = [(place, place + 1) for place in range(length - 1)]
    return graph_of(
        length + len(bays), row + [(place, length + number) for number, place in enumerate(bays)]
    )


def problem_of(graph: list[list[int]], starts: list[int], goals: list[int]) -> Problem:
    roadmap = Roadmap([(0.0, 0.0)] * len(graph), graph)
    return Problem(graph, tuple(starts), [roadmap.distances(goal) for goal in goals], goals)


@pytest.mark.parametrize("bay", [1, 3, 15, 26, 28])
def test_two_robots_swap_ends_of_a_corridor_wherever_the_bay_is(bay: int) -> None:
    found = solve(problem_of(corridor(30, [bay]), [0, 29], [29, 0]), [0, 1], 0, 1000)
    assert found is not None
    assert found[-1] == (29, 0)
    assert len(found) < 70


def test_a_robot_that_rests_in_a_dead_end_lets_another_one_in() -> None:
    problem = problem_of(corridor(12, [4, 5]), [11, 2], [10, 11])
    found = [solve(problem, order, 0, 1000) for order in ([0, 1], [1, 0])]
    assert any(one is not None and one[-1] == (10, 11) for one in found)


def test_what_cannot_be_is_given_up() -> None:
    assert solve(problem_of(corridor(4, []), [0, 3], [3, 0]), [0, 1], 0, 1000) is None


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), robots=st.integers(2, 10))
def test_in_every_step_robots_move_along_ways_to_places_of_their_own(
    seed: int, robots: int
) -> None:
    generator, places = random.Random(seed), 30
    ways = [(place, generator.randrange(max(0, place - 3), place)) for place in range(1, places)]
    ways += [(generator.randrange(places), generator.randrange(places)) for _ in range(6)]
    graph = graph_of(places, [way for way in ways if way[0] != way[1]])
    starts, goals = generator.sample(range(places), robots), generator.sample(range(places), robots)
    found = solve(problem_of(graph, starts, goals), list(range(robots)), seed, 300)
    for before, after in zip(found or [], (found or [])[1:], strict=False):
        assert len(set(after)) == robots
        for one in range(robots):
            assert after[one] == before[one] or after[one] in graph[before[one]]
            front = after[one]
            ring = {one}
            # A robot that moves to an occupied place waits for the robot there: the chain of waits must not be a cycle.
            while front in before and after[before.index(front)] != front:
                other = before.index(front)
                assert other not in ring
                ring.add(other)
                front = after[other]
