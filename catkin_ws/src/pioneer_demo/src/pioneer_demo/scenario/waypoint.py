"""Chooses waypoints for a fleet: seeded random places that each robot can reach and park at."""

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pioneer_demo.error import NoWaypointError
from pioneer_demo.scenario.floor import Floor, distances, drivable, route
from pioneer_fleet.geometry import Pose
from pioneer_node.core.reach import areas

# A Pioneer turning in place sweeps a circle of 0.36 m radius.
_PASSABLE = 0.42
_CELL = 0.2
_TRIALS = 40


@dataclasses.dataclass(frozen=True)
class WaypointConfig:
    """Criteria for waypoints."""

    count: int = 3  #: waypoints per robot
    clearance: float = 0.6  #: distance to the nearest wall [m]
    separation: float = 1.5  #: distance to other robots' waypoints and starts [m]
    #: shortest, longest: driving distance from the previous waypoint [m]
    shortest: float = 6.0
    longest: float = 14.0


@dataclasses.dataclass(frozen=True)
class Leg:
    """The route to one waypoint."""

    goal: Pose  #: in the frame ``map``; the heading is the direction of arrival in whole degrees
    way: NDArray[np.float64]  #: cells of a shortest path as positions [m], array [n, 2]
    length: float  #: length of that path [m]


def fleet_waypoints(
    floor: Floor, starts: Sequence[Pose], config: WaypointConfig, rng: np.random.Generator,
    goals: Sequence[Sequence[Sequence[float]]] = (),
) -> list[list[Leg]]:  # fmt: skip
    """Returns ``config.count`` legs per robot, or those to its ``goals``: x, y [m] and an optional heading [degrees].

    Among several random candidates it takes the one whose path is least close to other robots' paths and parking
    places, so that robots rarely meet.

    Raises:
        NoWaypointError: a robot cannot move at its start, a goal is unreachable, or there is no room left.
    """
    chooser = _Chooser(floor.cropped(), starts, config, rng)
    for robot, own in enumerate(goals):
        for goal in own:
            chooser.append(robot, goal)
    # Round by round, so that the first robot does not take all the space.
    for _ in range(config.count):
        for robot in range(len(starts)):
            if not (goals and goals[robot]):
                chooser.extend(robot)
    return chooser.legs


class _Chooser:
    def __init__(
        self, floor: Floor, starts: Sequence[Pose], config: WaypointConfig, rng: np.random.Generator
    ) -> None:
        self._config, self._rng, self._starts = config, rng, starts
        self._floor = floor
        self._passable = drivable(floor, _PASSABLE, _CELL)
        self._roomy = drivable(floor, config.clearance, _CELL).free
        self.legs: list[list[Leg]] = [[] for _ in starts]

    def append(self, robot: int, goal: Sequence[float]) -> None:
        """Appends the leg to a given goal to a robot's list."""
        x = float(goal[0])
        y = float(goal[1])
        try:
            leg = self._leg_to(self._passable, robot, x, y)
        except NoWaypointError:
            # The coarse floor leaves out narrow passages that the planner takes.
            leg = self._leg_to(self._narrow, robot, x, y)
        yaw = math.radians(goal[2]) if len(goal) > 2 else leg.goal.yaw
        self.legs[robot].append(dataclasses.replace(leg, goal=Pose(x, y, yaw)))

    @functools.cached_property
    def _narrow(self) -> Floor:
        """The floor in the map's own cells, by the planner's rule."""
        free = areas(self._floor.occupied, self._floor.resolution) > 0
        return dataclasses.replace(self._floor, free=free, occupied=~free)

    def _leg_to(self, floor: Floor, robot: int, x: float, y: float) -> Leg:
        steps = self._steps(floor, robot)
        row, col = _cell_near(floor, Pose(x, y), f"a goal of robot {robot + 1} is")
        if not np.isfinite(steps[row, col]):
            raise NoWaypointError(f"robot {robot + 1} cannot reach its goal ({x:g}, {y:g})")
        return _leg(floor, steps, row, col)

    def _steps(self, floor: Floor, robot: int) -> NDArray[np.float64]:
        last = self.legs[robot][-1].goal if self.legs[robot] else self._starts[robot]
        return distances(floor, *_cell_near(floor, last, f"robot {robot + 1} stands"))

    def extend(self, robot: int) -> None:
        """Appends a random leg to a robot's list."""
        steps = self._steps(self._passable, robot)
        candidates = self._candidates(robot, steps)
        if not len(candidates):
            raise NoWaypointError(
                f"no room for waypoint {len(self.legs[robot]) + 1} of robot {robot + 1}: try fewer robots, "
                "fewer waypoints or another world"
            )
        picked = self._rng.choice(candidates, min(_TRIALS, len(candidates)), replace=False)
        # Candidates are in random order, so ties in crowding are broken at random.
        trials = [_leg(self._passable, steps, int(row), int(col)) for row, col in picked]
        self.legs[robot].append(min(trials, key=lambda leg: self._crowding(robot, leg)))

    def _candidates(self, robot: int, steps: NDArray[np.float64]) -> NDArray[np.intp]:
        fits = self._roomy & np.isfinite(steps)
        if not fits.any():
            return np.argwhere(fits)
        # A world too small for the configured length gets the longest paths available.
        shortest = min(self._config.shortest, 0.5 * float(steps[fits].max()))
        fits &= (steps >= shortest) & (steps <= max(self._config.longest, shortest + _CELL))
        cells = np.argwhere(fits)
        xy = _positions(self._passable, cells)
        for place in self._places_of_others(robot):
            apart = np.hypot(xy[:, 0] - place.x, xy[:, 1] - place.y) >= self._config.separation
            cells, xy = cells[apart], xy[apart]
        return cells

    def _places_of_others(self, robot: int) -> list[Pose]:
        others = [index for index in range(len(self._starts)) if index != robot]
        return [self._starts[index] for index in others] + [
            leg.goal for i in others for leg in self.legs[i]
        ]

    def _crowding(self, robot: int, leg: Leg) -> float:
        """Returns the length of the path [m] that lies within the separation of other robots' paths and places."""
        places = np.array([(place.x, place.y) for place in self._places_of_others(robot)]).reshape(
            -1, 2
        )
        ways = [
            other.way for index, legs in enumerate(self.legs) if index != robot for other in legs
        ]
        busy = np.concatenate([places, *ways])
        if not len(busy):
            return 0.0
        gaps = np.hypot(*(leg.way[:, None, :] - busy[None, :, :]).transpose(2, 0, 1)).min(axis=1)
        return float(np.count_nonzero(gaps < self._config.separation)) * _CELL


def _leg(floor: Floor, steps: NDArray[np.float64], row: int, col: int) -> Leg:
    way = _positions(floor, np.array(route(steps, row, col)))
    start, end = way[max(0, len(way) - 6)], way[-1]
    heading = math.radians(round(math.degrees(math.atan2(end[1] - start[1], end[0] - start[0]))))
    goal = Pose(round(float(end[0]), 3), round(float(end[1]), 3), heading)
    return Leg(goal, way, float(steps[row, col]))


def _positions(floor: Floor, cells: NDArray[np.intp]) -> NDArray[np.float64]:
    return np.column_stack(floor.position(*cells.T))


def _cell_near(floor: Floor, pose: Pose, what: str) -> tuple[int, int]:
    """Returns the free cell nearest to ``pose``, at most half a metre away."""
    row, col = floor.cell(pose.x, pose.y)
    reach = math.ceil(0.5 / floor.resolution)
    cells = [
        (r, c)
        for r in range(row - reach, row + reach + 1)
        for c in range(col - reach, col + reach + 1)
    ]
    free = [cell for cell in cells if floor.contains(*cell) and floor.free[cell]]
    if not free:
        raise NoWaypointError(f"{what} at ({pose.x:.2f}, {pose.y:.2f}), where it cannot move")
    return min(free, key=lambda cell: math.dist(cell, (row, col)))
