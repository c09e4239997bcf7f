"""Whatever other programs publish as reports, and wherever goals are, a coordinator keeps working."""

import math
import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point
from pioneer_traffic.msg import Path, Plan, Report, Wait

from pioneer_traffic.config import PilotConfig
from pioneer_traffic.conversions import message_from_report, report_from_message
from pioneer_traffic.event import Event, GoalCancelled, Heard, Inputs, NewGoal, NewRoadmap, Send
from pioneer_traffic.pilot import Pilot
from pioneer_traffic.roadmap import FreeSpace, Roadmap, roadmap_from_space

NUMBERS = (0.0, -1.0, 3.3, 1e3, 1e8, -1.1e8, 1e18, 1e200, -1.7e308, math.inf, -math.inf, math.nan)
INTEGERS = (-1, 0, 1, 2, 5, 100, 2**31 - 1, -(2**31))
COUNTS = (0, 1, 2, 100, 2**32 - 1)
NAMES = ("a", "b", "c", "d", "", "é\n", "x" * 300)


def room() -> Roadmap:
    """Returns the roadmap of a room of 6 m x 6 m."""
    free = np.zeros((130, 130), bool)
    free[5:125, 5:125] = True
    free[50:80, 50:80] = False
    return roadmap_from_space(FreeSpace.of(free, 0.05, (0.0, 0.0)))


class Draw:
    """Draws messages, mostly plausible ones with single odd values."""

    def __init__(self, seed: int, roadmap: Roadmap) -> None:
        self.random = random.Random(seed)
        self.roadmap = roadmap

    def odd(self, usual: Callable[[], Any], odd: tuple[Any, ...]) -> Any:
        return self.random.choice(odd) if self.random.random() < 0.2 else usual()

    def place(self) -> int:
        number: int = self.odd(lambda: self.random.randrange(len(self.roadmap.places)), INTEGERS)
        return number

    def places(self) -> list[int]:
        return [self.place() for _ in range(self.random.randrange(4))]

    def name(self) -> str:
        name: str = self.random.choice(NAMES)
        return name

    def number(self) -> int:
        number: int = self.odd(lambda: self.random.randrange(6), COUNTS)
        return number

    def point(self) -> tuple[float, float]:
        x, y = (self.odd(lambda: self.random.uniform(0.0, 6.5), NUMBERS) for _ in range(2))
        return x, y

    def report(self) -> Report:
        chance = self.random
        paths = [
            Path(self.name(), self.places(), self.places(), self.places())
            for _ in range(chance.randrange(4))
        ]
        waits = [
            Wait(self.name(), self.place(), self.name(), self.place())
            for _ in range(chance.randrange(3))
        ]
        signature = chance.choice((self.roadmap.signature, self.roadmap.signature, 7))
        return Report(
            robot=self.name(),
            roadmap=signature,
            position=Point(*self.point(), self.odd(lambda: 0.0, NUMBERS)),
            held=self.places(),
            goal=self.place(),
            since=self.odd(lambda: chance.uniform(0.0, 1e4), NUMBERS),
            region=self.places(),
            out=chance.random() < 0.3,
            adopted=self.number(),
            adopted_author=self.name(),
            reached=self.place(),
            ready=self.number(),
            ready_author=self.name(),
            heard=[self.name() for _ in range(chance.randrange(5))],
            plan=Plan(self.number(), self.name(), paths, waits),
        )

    def event(self) -> Event | None:
        if self.random.random() < 0.05:
            return NewGoal(self.point())
        if self.random.random() < 0.02:
            return GoalCancelled("cancelled")
        report = report_from_message(
            self.report(), self.roadmap.signature, len(self.roadmap.places)
        )
        return None if report is None else Heard(report)


@pytest.mark.parametrize("seed", range(12))
def test_odd_reports_and_goals_stop_no_coordinator(seed: int) -> None:
    """A position of 1.7e308 m ended it: the number of a patch of ground there is infinite."""
    roadmap = room()
    draw = Draw(seed, roadmap)
    pilot = Pilot("a", PilotConfig(), ("b", "c"))
    now = 1000.0
    pilot.step([NewRoadmap(roadmap)], Inputs((1.0, 1.0), now, True), now)
    sent = 0
    for _ in range(250):
        now += draw.random.choice((0.2, 0.2, 0.2, 1.0, 30.0, -5.0))
        events = [event for event in (draw.event() for _ in range(3)) if event is not None]
        place = draw.random.choice((None, (1.0, 1.0), (5.5, 5.5), (1e8, -1e8)))
        for action in pilot.step(events, Inputs(place, now, draw.random.random() < 0.9), now):
            if isinstance(action, Send):
                sent += 1
                message_from_report(action.report, None)
    assert sent > 100


@pytest.mark.parametrize("number", [1.1e8, -1e200, 1.7e308, math.inf, math.nan])
@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_report_from_farther_than_any_robot_is_refused(axis: str, number: float) -> None:
    message = Report(robot="b", position=Point(1.0, 1.0, 0.0))
    setattr(message.position, axis, number)
    assert report_from_message(message, 1, 10) is None
