"""Fleets of pilots on the roadmap, with goals that coincide: every goal ends, no robot touches another."""

import math
import random
from collections.abc import Sequence

import pytest

from pioneer_traffic.config import PilotConfig
from pioneer_traffic.event import (
    CancelDrive,
    CancelRequested,
    Drive,
    Event,
    Finish,
    Heard,
    Inputs,
    MoveBaseTaken,
    NewGoal,
    NewRoadmap,
    Send,
    StretchEnded,
)
from pioneer_traffic.geometry import Point
from pioneer_traffic.pilot import Pilot
from pioneer_traffic.roadmap import Roadmap
from pioneer_traffic.simulation import STEP, TICK, Trial
from simple_navigation_goals.queue import Outcome

ARRIVED = 0.2
"""Distance at which the robots' move_base reports its goal as reached [m]."""


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


ROOMS = lattice(
    ["...   ...", ".........", "...   ...", " .     . ", "...   ...", ".........", "...   ..."]
)


class Fleet(Trial):
    """Robots with pilots, and a move_base each that drives along the route to the stop that it was sent."""

    def __init__(
        self, roadmap: Roadmap, starts: Sequence[Point], tours: Sequence[Sequence[Point]], seed: int
    ) -> None:
        super().__init__(roadmap, None, starts, [[] for _ in starts], seed=seed)
        names = [f"robot{number:02}" for number in range(len(starts))]
        self.pilots = [Pilot(name, PilotConfig(), names) for name in names]
        self.goals = [list(tour) for tour in tours]
        self.inboxes: list[list[Event]] = [[NewRoadmap(roadmap)] for _ in names]
        self.drives: list[Drive | None] = [None] * len(names)
        self.results: list[list[Finish]] = [[] for _ in names]

    def is_done(self, index: int) -> bool:
        """Returns whether a robot has no goal left; one that is gone has none."""
        return not self.present[index] or not (self.goals[index] or self.pilots[index].has_goal)

    def finish(self, limit: float) -> None:
        """Runs until no robot has a goal left."""
        while not all(self.is_done(index) for index in range(len(self.pilots))):
            self.step()
            assert self.time < limit, "a goal did not end"

    def step(self) -> None:
        """Advances by one time step."""
        self._steps += 1
        self.time = self._steps * STEP
        for index in range(len(self.pilots)):
            if self.present[index]:
                if (self._steps + index) % TICK == 0:
                    self.act(index)
                self.move(index)
        self._look_for_contacts()

    def move(self, index: int) -> None:
        """Moves a robot towards its stop."""
        drive = self.drives[index]
        body = self.bodies[index]
        if drive is None:
            return
        body.drive(self.route_to(index, drive))
        if math.dist(body.position, drive.stop) < ARRIVED:
            self.inboxes[index].append(StretchEnded(drive.number, Outcome.REACHED, ""))
            self.drives[index] = None
            body.speed = 0.0

    def act(self, index: int) -> None:
        """Runs a pilot's step."""
        pilot = self.pilots[index]
        if not pilot.has_goal and self.goals[index]:
            self.inboxes[index].append(NewGoal(self.goals[index].pop(0)))
        events = self.inboxes[index]
        self.inboxes[index] = []
        for action in pilot.step(events, Inputs(self.bodies[index].position, self.time), self.time):
            match action:
                case Drive():
                    self.drives[index] = action
                case CancelDrive():
                    self.drives[index] = None
                    self.bodies[index].speed = 0.0
                case Finish():
                    self.results[index].append(action)
                case Send(report):
                    for inbox in self.inboxes:
                        inbox.append(Heard(report))

    def route_to(self, index: int, drive: Drive) -> list[Point]:
        """Returns the points through which move_base drives: the pilot's route, as long as that leads to the stop."""
        coordinator = self.pilots[index]._coordinator
        route = coordinator.route if coordinator is not None else []
        leads_there = bool(route) and math.dist(route[-1], drive.stop) <= PilotConfig().reach
        return [*route[:-1], drive.stop] if leads_there else [drive.stop]


def fleet_of(robots: int, seed: int) -> Fleet:
    """Returns a fleet whose goals are drawn with repetition from six points, which are places or near them."""
    generator = random.Random(seed)
    points = []
    for x, y in generator.sample(ROOMS.places, 6):
        points.append((x + generator.uniform(-0.3, 0.3), y + generator.uniform(-0.3, 0.3)))
    tours = [[generator.choice(points) for _ in range(3)] for _ in range(robots)]
    return Fleet(ROOMS, generator.sample(ROOMS.places, robots), tours, seed)


@pytest.mark.parametrize(("robots", "seed"), [(7, 5), (5, 23)])
def test_robots_that_head_straight_beyond_what_they_hold_touch_nobody(
    robots: int, seed: int
) -> None:
    """They touched others on the ways beside their paths."""
    fleet = fleet_of(robots, seed)
    fleet.finish(900.0)
    assert not fleet._touching


@pytest.mark.parametrize("seed", range(4))
def test_goals_that_coincide_are_reached_one_after_the_other(seed: int) -> None:
    fleet = fleet_of(5, seed)
    fleet.finish(900.0)
    assert [[finish.outcome for finish in results] for results in fleet.results] == [
        [Outcome.REACHED] * 3
    ] * 5
    assert not fleet._touching


@pytest.mark.parametrize("how", ["stopped", "driven by another client", "switched off"])
@pytest.mark.parametrize("seed", range(3))
def test_with_a_robot_that_takes_no_part_every_goal_ends_with_the_reason(
    how: str, seed: int
) -> None:
    fleet = fleet_of(5, seed)
    while fleet.time < 10.0 + 5.0 * seed:
        fleet.step()
    fleet.goals[0] = []
    if how == "switched off":
        fleet.present[0] = False
    else:
        fleet.inboxes[0].append(
            CancelRequested(everything=True) if how == "stopped" else MoveBaseTaken("/rviz")
        )
        fleet.drives[0] = None
    fleet.finish(900.0)
    for results in fleet.results[1:]:
        assert len(results) == 3
        for finish in results:
            assert finish.outcome is Outcome.REACHED or "past robot00" in finish.text
    assert not fleet._touching
    drives = len([drive for drive in fleet.drives[:1] if drive is not None])
    assert drives == 0 or how == "switched off"
