"""Paths for several robots on one graph: LaCAM (Okumura 2023) with PIBT (Okumura et al. 2022) to generate steps.

A configuration is the place of each robot. LaCAM searches the configurations depth first; from each it first tries
PIBT's step: robots step towards their goals by priority, and push those in their way aside. "Swap" (Okumura,
"Improving LaCAM for scalable eventually optimal multi-agent pathfinding", IJCAI 2023) lets two robots that meet in a
narrow passage back off to where they can pass. Unlike in these papers, a ring of robots may not rotate: each waits
until the one in front has left.
"""

import random
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

Graph = Sequence[Sequence[int]]
Configuration = tuple[int, ...]


@dataclass(frozen=True)
class Problem:
    """Starts and goals of the robots on a graph."""

    graph: Graph  #: neighbours of each place, without ways into places that are closed to all
    starts: Configuration  #: start place of each robot, all different
    distances: Sequence[Sequence[int]]  #: for each robot, the steps from each place to its target
    goals: Sequence[int | None]  #: place that each robot must end at; None if it may end anywhere


@dataclass
class _Node:
    places: Configuration
    parent: "_Node | None"
    waited: tuple[float, ...]
    order: list[int]
    constraints: deque[tuple[tuple[int, int], ...]] = field(default_factory=lambda: deque([()]))


def solve(
    problem: Problem, order: Sequence[int], seed: int, most: int
) -> list[Configuration] | None:
    """Returns the configurations from the starts to one with all robots at their goals; None after ``most`` tries.

    ``order`` lists the robots by descending priority. The same seed gives the same result.
    """
    generator = random.Random(seed)
    # Less than one step of waiting.
    rank = {robot: 1.0 - place / (len(order) + 1) for place, robot in enumerate(order)}
    first = _node(problem, problem.starts, None, tuple(rank[robot] for robot in range(len(order))))
    stack, known = [first], {problem.starts: first}
    for _ in range(most):
        if not stack:
            return None
        node = stack[-1]
        if all(
            goal in (None, place) for goal, place in zip(problem.goals, node.places, strict=True)
        ):
            return _back_from(node)
        if not node.constraints:
            stack.pop()
            continue
        constraint = node.constraints.popleft()
        _refine(problem, node, constraint, generator)
        places = _Step(problem, node, generator).taken(constraint)
        if places is None:
            continue
        if places not in known:
            known[places] = _node(problem, places, node, node.waited)
        stack.append(known[places])
    return None


def _node(
    problem: Problem, places: Configuration, parent: _Node | None, before: tuple[float, ...]
) -> _Node:
    """Returns a search node; a robot's priority rises with each step until it is at its goal."""
    waited = tuple(
        value % 1.0 if goal in (None, place) else value + 1.0
        for value, goal, place in zip(before, problem.goals, places, strict=True)
    )
    return _Node(
        places, parent, waited, sorted(range(len(places)), key=lambda robot: -waited[robot])
    )


def _refine(
    problem: Problem, node: _Node, constraint: tuple[tuple[int, int], ...], generator: random.Random
) -> None:
    """Queues the constraints that fix the step of one more robot."""
    if len(constraint) == len(node.places):
        return
    robot = node.order[len(constraint)]
    choices = [*problem.graph[node.places[robot]], node.places[robot]]
    generator.shuffle(choices)
    node.constraints.extend((*constraint, (robot, place)) for place in choices)


def _back_from(node: _Node) -> list[Configuration]:
    found = [node.places]
    while node.parent is not None:
        node = node.parent
        found.append(node.places)
    return found[::-1]


class _Step:
    """Plans one step of all robots by PIBT, under constraints."""

    def __init__(self, problem: Problem, node: _Node, generator: random.Random) -> None:
        self._graph, self._distances, self._goals = problem.graph, problem.distances, problem.goals
        self._now, self._order, self._generator = node.places, node.order, generator
        self._next: list[int | None] = [None] * len(node.places)
        self._occupant = {place: robot for robot, place in enumerate(node.places)}
        self._claimant: dict[int, int] = {}

    def taken(self, constraint: tuple[tuple[int, int], ...]) -> Configuration | None:
        """Returns the next configuration; None if the constraint allows none."""
        for robot, place in constraint:
            if place in self._claimant:
                return None
            self._claim(robot, place)
        if any(self._turns_in_a_ring(robot) for robot, _ in constraint):
            return None
        for robot in self._order:
            if self._next[robot] is None and not self._move(robot):
                return None
        places = tuple(place for place in self._next if place is not None)
        return places if len(set(places)) == len(self._now) else None

    def _claim(self, robot: int, place: int) -> None:
        self._next[robot] = place
        self._claimant[place] = robot

    def _turns_in_a_ring(self, robot: int) -> bool:
        """Returns whether the robot waits in a ring of robots, each for the next; two that swap are a ring."""
        other: int | None = robot
        while other is not None:
            place = self._next[other]
            if place is None or place == self._now[other]:
                return False
            other = self._occupant.get(place)
            if other == robot:
                return True
        return False

    def _move(self, robot: int) -> bool:
        """Moves the robot one step, and first those in its way; returns False if it has to stay."""
        here, distance = self._now[robot], self._distances[robot]
        occupant, chance = self._occupant, self._generator.random
        choices = [*self._graph[here], here]
        choices.sort(
            key=lambda place: (distance[place], place in occupant and place != here, chance())
        )
        partner = self._swap_partner(robot, choices)
        if partner is not None:
            choices.reverse()
        for rank, place in enumerate(choices):
            if place in self._claimant:
                continue
            self._claim(robot, place)
            if self._turns_in_a_ring(robot):
                self._drop(robot, place)
                continue
            other = self._occupant.get(place)
            if (
                other is not None
                and other != robot
                and self._next[other] is None
                and not self._move(other)
            ):
                continue
            if (
                rank == 0
                and partner is not None
                and self._next[partner] is None
                and here not in self._claimant
            ):
                self._claim(partner, here)
            return True
        self._claim(robot, here)
        return False

    def _drop(self, robot: int, place: int) -> None:
        self._next[robot] = None
        del self._claimant[place]

    def _swap_partner(self, robot: int, choices: list[int]) -> int | None:
        """Returns the robot that this one must swap with, and can by going backwards; None if there is none."""
        here, ahead = self._now[robot], choices[0]
        if ahead == here:
            return None
        other = self._occupant.get(ahead)
        if (
            other is not None
            and self._next[other] is None
            and self._must_swap(robot, other, here, ahead)
        ):
            return other if self._can_swap(ahead, here) else None
        # Another robot has to pass, and this one makes room by moving ahead.
        for place in self._graph[here]:
            other = self._occupant.get(place)
            if other is None or other == robot or place == ahead or self._next[other] is not None:
                continue
            if self._must_swap(other, robot, here, ahead) and self._can_swap(ahead, here):
                return other
        return None

    def _onward(self, place: int, before: int) -> list[int]:
        """Returns the ways on from ``place``, without the way back and dead ends with a robot at its goal."""
        return [
            other
            for other in self._graph[place]
            if other != before and not (len(self._graph[other]) == 1 and self._rests_at(other))
        ]

    def _rests_at(self, place: int) -> bool:
        robot = self._occupant.get(place)
        return robot is not None and self._goals[robot] == place

    def _must_swap(self, pusher: int, pulled: int, behind: int, ahead: int) -> bool:
        """Returns whether the two robots cannot pass each other on the pusher's way ahead."""
        mine, theirs = self._distances[pusher], self._distances[pulled]
        while mine[ahead] < mine[behind]:
            onward = self._onward(ahead, behind)
            if len(onward) >= 2:
                return False
            if not onward:
                break
            behind, ahead = ahead, onward[0]
        return theirs[behind] < theirs[ahead] and (mine[behind] == 0 or mine[ahead] < mine[behind])

    def _can_swap(self, behind: int, ahead: int) -> bool:
        """Returns whether going backwards, from ``behind`` through ``ahead``, leads to a place with two ways on."""
        first = behind
        while ahead != first:
            onward = self._onward(ahead, behind)
            if len(onward) >= 2:
                return True
            if not onward:
                return False
            behind, ahead = ahead, onward[0]
        return False
