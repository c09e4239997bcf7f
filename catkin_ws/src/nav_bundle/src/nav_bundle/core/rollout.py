"""Velocity samples rolled out over the local costmap and scored, one kernel call a question."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core import kernel
from nav_bundle.core.local_planner import Situation, Velocity
from nav_bundle.core.pose import Pose

_COST, _X, _Y, _YAW = 0, 1, 2, 3
_NO_PLAN = np.empty((0, 2))


@dataclass(frozen=True)
class Scales:
    """Cost of a cell's step to the plan and to the local goal, of a unit of costmap cost, of a radian of heading."""

    plan: float
    goal: float
    obstacle: float
    heading: float = 0.0


@dataclass(frozen=True)
class Horizon:
    """How far samples are followed: time [s], way [m] and turning speed [rad/s] between two looks.

    ``heading`` [s] is when a sample is scored where headings count, which is at its end otherwise.
    """

    time: float
    way: float
    turn: float
    heading: float = 0.0


@dataclass(frozen=True)
class Scored:
    """A sample that may be driven: its velocity, cost, and the end that was scored."""

    velocity: Velocity
    cost: float
    end: Pose


class Rollout:
    """Scores samples of one moment: the costmap, the distances to plan and goal, the robot's motion."""

    def __init__(self, acc: Velocity, horizon: Horizon, scales: Scales) -> None:
        self._acc = np.array([acc.x, acc.y, acc.turn], np.float64)
        self._horizon = np.array([horizon.time, horizon.way, horizon.turn], np.float64)
        self._scales = np.array([scales.plan, scales.goal, scales.obstacle, scales.heading], np.float64)
        self.horizon = horizon
        self._headings = scales.heading > 0.0
        self._ahead = _NO_PLAN
        self._to_plan = np.empty((0, 0), np.int32)

    def begin(self, situation: Situation, plan: NDArray[np.float64]) -> bool:
        """Takes a moment and fills the distance grids from ``plan`` (n, 3); False if it misses the costmap."""
        costmap = situation.costmap
        self._costmap = costmap
        place = costmap.geometry
        self._place = (place.origin_x, place.origin_y, place.resolution)
        if self._to_plan.shape != costmap.cells.shape:
            self._to_plan = np.empty(costmap.cells.shape, np.int32)
            self._to_goal = np.empty(costmap.cells.shape, np.int32)
            self._queue = np.empty(costmap.cells.size, np.int32)
        pose, velocity = situation.pose, situation.velocity
        self._pose = np.array([pose.x, pose.y, pose.yaw], np.float64)
        self._velocity = np.array([velocity.x, velocity.y, velocity.turn], np.float64)
        outline = costmap.footprint.outline(pose)
        points = np.ascontiguousarray(plan[:, :2])
        self._ahead = points if self._headings else _NO_PLAN
        grids = (self._to_plan, self._to_goal, self._queue)
        return bool(kernel.distance_grids(costmap.cells, *self._place, points, outline, *grids) > 0)

    def cheapest(self, samples: NDArray[np.float64]) -> Scored | None:
        """Returns the cheapest of ``samples`` (n, 3), the first of equals; None if none may be driven."""
        best, results = self._search(samples, True, False)
        return None if best < 0 else _scored(samples[best], results[best])

    def all_of(self, samples: NDArray[np.float64]) -> list[Scored]:
        """Returns all of ``samples`` (n, 3) that may be driven, in their order."""
        _, results = self._search(samples, True, True)
        return [_scored(sample, result) for sample, result in zip(samples, results, strict=True) if result[_COST] >= 0]

    def is_free(self, velocity: Velocity, time: float = math.inf) -> bool:
        """Tells whether ``velocity``, driven for ``time`` [s], the horizon's at most, touches nothing."""
        sample = np.array([[velocity.x, velocity.y, velocity.turn]], np.float64)
        return self._search(sample, False, True, time)[0] >= 0

    def _search(
        self, samples: NDArray[np.float64], reach: bool, every: bool, time: float = math.inf
    ) -> tuple[int, NDArray[np.float64]]:
        results = np.empty((len(samples), 5))
        best = kernel.search(
            self._costmap.cells,
            *self._place,
            self._to_plan,
            self._to_goal,
            self._costmap.footprint.vertices,
            self._pose,
            self._velocity,
            self._acc,
            samples,
            self._until(time),
            self._scales,
            reach,
            every,
            self._ahead if reach else _NO_PLAN,
            self.horizon.heading,
            results,
        )
        return int(best), results

    def _until(self, time: float) -> NDArray[np.float64]:
        """Returns the horizon, cut off at ``time`` [s]."""
        return np.minimum(self._horizon, (time, math.inf, math.inf))

    def poses(self, velocity: Velocity, time: float = math.inf) -> NDArray[np.float64]:
        """Returns the poses (n, 3) that ``velocity`` leads through within ``time`` [s], the horizon's at most."""
        poses = np.empty((256, 3))
        sample = np.array([velocity.x, velocity.y, velocity.turn], np.float64)
        count = kernel.roll_out(self._pose, self._velocity, self._acc, sample, self._until(time), poses)
        return poses[:count]

    def goal_distance(self, x: float, y: float) -> int | None:
        """Returns the steps from the cell at ``x, y`` [m] to the local goal, None outside the costmap."""
        place = self._costmap.geometry
        row, col = place.row_of(y), place.col_of(x)
        if not (0 <= row < place.rows and 0 <= col < place.cols):
            return None
        return int(self._to_goal[row, col])


def _scored(sample: NDArray[np.float64], result: NDArray[np.float64]) -> Scored:
    x, y, turn = (float(value) for value in sample)
    end = Pose(float(result[_X]), float(result[_Y]), float(result[_YAW]))
    return Scored(Velocity(x, y, turn), float(result[_COST]), end)
