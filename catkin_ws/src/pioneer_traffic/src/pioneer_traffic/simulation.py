"""Robots driven by their coordinators, without ROS: kinematics, footprints, and reports delayed by one tick."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pioneer_traffic.config import CoordinatorConfig
from pioneer_traffic.coordinator import Coordinator
from pioneer_traffic.geometry import Point
from pioneer_traffic.roadmap import FreeSpace, Roadmap

FOOTPRINT = np.array([[0.20, 0.20], [0.20, -0.20], [-0.30, -0.20], [-0.30, 0.20]])
"""Corners of a Pioneer relative to base_link [m]."""
STEP, TICK = 0.05, 4
"""Time step [s], and steps between two reports of a robot."""
SPEED, ACCELERATION, TURN = 0.8, 1.0, 1.0
"""Limits of a robot [m/s, m/s², rad/s]."""
_ASTRAY = 0.5
"""Heading error above which a robot turns in place [rad]."""
_NEXT, _REACH = 0.1, 0.2
"""Distances at which a point of the route counts as passed, and a place as reached [m]."""
_NEAR = 1.2
"""Distance of footprints' centres up to which their gap is checked [m]."""

Points = NDArray[np.float64]


@dataclass
class Body:
    """A robot's pose in map and speed; it drives straight to the points of its route."""

    x: float
    y: float
    yaw: float = 0.0
    speed: float = 0.0

    @property
    def position(self) -> Point:
        """The position x, y [m]."""
        return self.x, self.y

    def drive(self, route: Sequence[Point]) -> None:
        """Moves for one time step; stops at the last point."""
        points = list(route)
        while len(points) > 1 and math.dist(self.position, points[0]) < _NEXT:
            points.pop(0)
        left = sum(math.dist(a, b) for a, b in zip([self.position, *points], points, strict=False))
        if left < 0.03:
            self.speed = 0.0
            return
        bearing = math.atan2(points[0][1] - self.y, points[0][0] - self.x)
        error = math.remainder(bearing - self.yaw, math.tau)
        wanted = SPEED * max(0.0, 1.0 - abs(error) / _ASTRAY)
        wanted = min(wanted, math.sqrt(2.0 * ACCELERATION * left))
        change = ACCELERATION * STEP
        self.speed += min(change, max(-2.0 * change, wanted - self.speed))
        self.yaw += min(TURN * STEP, max(-TURN * STEP, error))
        self.x += self.speed * STEP * math.cos(self.yaw)
        self.y += self.speed * STEP * math.sin(self.yaw)


@dataclass(frozen=True)
class Outcome:
    """Results of a trial."""

    reached: int  #: waypoints reached by all robots
    asked: int  #: waypoints given
    contacts: int  #: pairs of robots that touched, plus robots that touched a wall
    finished: tuple[
        float, ...
    ]  #: time at which each robot reached its last waypoint [s]; inf if it did not
    gap: float  #: least distance between two footprints [m]
    shared: bool  #: whether two robots ever held the same place


class Trial:
    """Robots with tours of waypoints on one map.

    Args:
        roadmap: of the map.
        space: of the map; None to ignore walls.
        starts: of the robots.
        tours: waypoints of each robot.
        loss: share of reports that are lost.
        seed: of lost reports and start headings.
    """

    def __init__(
        self,
        roadmap: Roadmap,
        space: FreeSpace | None,
        starts: Sequence[Point],
        tours: Sequence[Sequence[Point]],
        loss: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._space, self._tours = space, [list(tour) for tour in tours]
        self._random, self._loss = random.Random(seed), loss
        names = [f"robot{number:02}" for number in range(len(starts))]
        self.bodies = [Body(x, y, self._random.uniform(-math.pi, math.pi)) for x, y in starts]
        self.coordinators = [
            Coordinator(name, roadmap, CoordinatorConfig(reach=_REACH), names) for name in names
        ]
        self.present = [True] * len(starts)
        #: links that are cut, by the indices of sender and receiver
        self.cut: set[tuple[int, int]] = set()
        self.time, self.gap, self.shared = 0.0, math.inf, False
        self._steps = 0
        self._reached = [0] * len(starts)
        self._finished = [math.inf] * len(starts)
        self._touching: set[tuple[int, int]] = set()
        for index, coordinator in enumerate(self.coordinators):
            self._send_on(index, coordinator)

    def run(self, limit: float) -> Outcome:
        """Drives until all tours are done, or for ``limit`` [s]; returns the results."""
        while self.time < limit and math.inf in self._finished:
            self.step()
        asked = sum(len(tour) for tour in self._tours)
        return Outcome(
            sum(self._reached),
            asked,
            len(self._touching),
            tuple(self._finished),
            self.gap,
            self.shared,
        )

    def carry(self, index: int, point: Point) -> None:
        """Puts a robot elsewhere, as if somebody carried it."""
        body = self.bodies[index]
        body.x, body.y = point
        body.speed = 0.0

    def step(self) -> None:
        """Advances by one time step; robots send their reports in turn, not all at once."""
        self._steps += 1
        self.time = self._steps * STEP
        for index, (body, coordinator) in enumerate(
            zip(self.bodies, self.coordinators, strict=True)
        ):
            if not self.present[index]:
                continue
            if (self._steps + index) % TICK == 0:
                self._speak(index, coordinator)
            body.drive(coordinator.route)
        if self._steps % 2 == 0:
            self._look_for_contacts()

    def _speak(self, index: int, coordinator: Coordinator) -> None:
        report = coordinator.advance(self.bodies[index].position, self.time)
        for other, receiver in enumerate(self.coordinators):
            is_linked = other != index and self.present[other] and (index, other) not in self.cut
            if is_linked and self._random.random() >= self._loss:
                receiver.receive(report, self.time)
        held = [
            set(self.coordinators[one].report.held)
            for one in range(len(self.bodies))
            if one != index
        ]
        moving = report.adopted.number > 0
        self.shared |= moving and any(set(report.held) & places for places in held)
        if coordinator.finished:
            self._reached[index] += 1
            self._send_on(index, coordinator)

    def _send_on(self, index: int, coordinator: Coordinator) -> None:
        """Gives a robot its next waypoint."""
        tour = self._tours[index]
        if self._reached[index] < len(tour):
            coordinator.set_waypoint(tour[self._reached[index]], self.time)
        else:
            coordinator.set_waypoint(None, self.time)
            self._finished[index] = self.time

    def _look_for_contacts(self) -> None:
        corners, axes = _footprints(self.bodies)
        if self._space is not None:
            sides = np.roll(corners, -1, axis=1) - corners
            outlines = (
                corners[:, :, None]
                + np.linspace(0.0, 1.0, 4, endpoint=False)[:, None] * sides[:, :, None]
            )
            rooms = self._space.room_at(outlines.reshape(-1, 2)).reshape(len(corners), -1)
            self._touching.update(
                (robot, robot) for robot in np.flatnonzero((rooms <= 0.0).any(axis=1)).tolist()
            )
        one, other = np.triu_indices(len(corners), 1)
        near = np.hypot(*(corners[one] - corners[other]).mean(axis=1).T) < _NEAR
        if near.any():
            one, other = one[near], other[near]
            gaps = _gaps(
                corners[one], corners[other], np.concatenate([axes[one], axes[other]], axis=1)
            )
            self.gap = min(self.gap, float(gaps.min()))
            self._touching.update(
                zip(one[gaps <= 0.0].tolist(), other[gaps <= 0.0].tolist(), strict=True)
            )


def _footprints(bodies: Sequence[Body]) -> tuple[Points, Points]:
    """Returns the footprints' corners in map, shape (robots, 4, 2), and the sides' directions, (robots, 2, 2)."""
    yaw = np.array([body.yaw for body in bodies])
    axes = np.stack([np.cos(yaw), np.sin(yaw), -np.sin(yaw), np.cos(yaw)], axis=1).reshape(-1, 2, 2)
    return FOOTPRINT @ axes + np.array([body.position for body in bodies])[:, None], axes


def _gaps(one: Points, other: Points, axes: Points) -> NDArray[np.float64]:
    """Returns each pair of rectangles' largest gap along any of their sides [m]; 0 or less if they touch."""
    first, second = one @ axes.swapaxes(1, 2), other @ axes.swapaxes(1, 2)
    ahead, behind = second.min(axis=1) - first.max(axis=1), first.min(axis=1) - second.max(axis=1)
    found: NDArray[np.float64] = np.maximum(ahead, behind).max(axis=1)
    return found
