"""Rolls out and scores velocity samples on the local costmap, all samples in one kernel call."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import Velocity
from nav_bundle.control import trajectory_kernel as kernel
from nav_bundle.control.clearance import Clearance
from nav_bundle.control.local_planner import Situation
from nav_bundle.control.plan_distance_kernel import Floor, distance_grids
from nav_bundle.control.trajectory_kernel import Ground, Horizon, Motion, Scales
from nav_bundle.costmap.cost import INSCRIBED
from nav_bundle.costmap.costmap import Costmap

_COST, _X, _Y, _YAW = 0, 1, 2, 3
_NO_PLAN = np.empty((0, 2))


@dataclass(frozen=True)
class Scored:
    """A valid sample: its velocity, cost and scored end pose."""

    velocity: Velocity
    cost: float
    end: Pose


class Rollout:
    """Scores velocity samples for one cycle from costmap, distances to plan and goal, and the robot's motion."""

    def __init__(
        self, acc: Velocity, horizon: Horizon, scales: Scales, clearance: Clearance
    ) -> None:
        self._acc = np.array([acc.x, acc.y, acc.turn], np.float64)
        self.horizon, self._scales, self._clearance = horizon, scales, clearance
        self._headings = scales.heading > 0.0
        self._ahead = _NO_PLAN
        self._to_plan = self._to_goal = np.empty((0, 0), np.int32)
        self._queue = np.empty(0, np.int32)
        # Inputs of the current cycle, set by ``begin``.
        self._costmap: Costmap
        self._motion: Motion
        self._ground: Ground
        self._floor: Floor

    def begin(self, situation: Situation, plan: NDArray[np.float64]) -> bool:
        """Starts a cycle and fills the distance grids from ``plan`` (n, 3); False if the plan misses the costmap."""
        costmap = situation.costmap
        self._costmap = costmap
        if self._to_plan.shape != costmap.cells.shape:
            self._to_plan = np.empty(costmap.cells.shape, np.int32)
            self._to_goal = np.empty(costmap.cells.shape, np.int32)
            self._queue = np.empty(costmap.cells.size, np.int32)
        pose, velocity, place = situation.pose, situation.velocity, costmap.geometry.place
        self._motion = Motion(
            np.array([pose.x, pose.y, pose.yaw], np.float64),
            np.array([velocity.x, velocity.y, velocity.turn], np.float64),
            self._acc,
        )
        steps = self._to_plan, self._to_goal
        clearance = self._clearance
        prices = (
            clearance.prices(costmap),
            clearance.allowed(situation, plan),
            clearance.ends(costmap.footprint),
        )
        self._ground = Ground(costmap.cells, place, *steps, costmap.footprint.vertices, *prices)
        self._floor = Floor(costmap.cells, place, costmap.footprint.outline(pose))
        points = np.ascontiguousarray(plan[:, :2])
        self._ahead = points if self._headings else _NO_PLAN
        return distance_grids(self._floor, points, self._to_plan, self._to_goal, self._queue) > 0

    def cheapest(self, samples: NDArray[np.float64]) -> Scored | None:
        """Returns the cheapest of ``samples`` (n, 3), the first of equals; None if none is valid."""
        best, results = self._search(samples, True, False)
        return None if best < 0 else _scored(samples[best], results[best])

    def all_of(self, samples: NDArray[np.float64], limit: float = math.inf) -> list[Scored]:
        """Returns all valid ``samples`` (n, 3) that cost at most ``limit``, in their order."""
        _, results = self._search(samples, True, True, limit=limit)
        return [
            _scored(sample, result)
            for sample, result in zip(samples, results, strict=True)
            if result[_COST] >= 0
        ]

    def is_free(self, velocity: Velocity, time: float = math.inf) -> bool:
        """Returns whether ``velocity`` is collision-free for ``time`` [s], at most the horizon."""
        sample = np.array([[velocity.x, velocity.y, velocity.turn]], np.float64)
        return self._search(sample, False, True, time)[0] >= 0

    def _search(
        self,
        samples: NDArray[np.float64],
        reach: bool,
        every: bool,
        time: float = math.inf,
        limit: float = math.inf,
    ) -> tuple[int, NDArray[np.float64]]:
        results = np.empty((len(samples), 5))
        ahead = self._ahead if reach else _NO_PLAN
        moment = (self._ground, self._motion, samples, self._until(time), self._scales)
        return kernel.search(*moment, ahead, reach, every, limit, results), results

    def _until(self, time: float) -> Horizon:
        """Returns the horizon, limited to ``time`` [s]."""
        return self.horizon._replace(time=min(self.horizon.time, time))

    def poses(self, velocity: Velocity, time: float = math.inf) -> NDArray[np.float64]:
        """Returns the poses (n, 3) along ``velocity`` within ``time`` [s], at most the horizon."""
        poses = np.empty((256, 3))
        sample = np.array([velocity.x, velocity.y, velocity.turn], np.float64)
        count = kernel.roll_out(self._motion, sample, self._until(time), poses)
        return poses[:count]

    def cell_costs(self) -> NDArray[np.float64]:
        """Returns the cost terms of samples that end in each of the costmap's cells, shape (n, 6).

        The columns are x, y [m] of the cell's centre, steps to the plan, steps to the goal, costmap cost, and the
        weighted sum of the three. Only cells where the robot's centre may be and that are connected to plan and goal.
        """
        if not self._to_plan.size:
            return np.empty((0, 6))
        place, cells, scales = self._costmap.geometry, self._costmap.cells, self._scales
        at = np.nonzero(
            (cells < INSCRIBED) & (self._to_plan < cells.size) & (self._to_goal < cells.size)
        )
        parts = np.stack([self._to_plan[at], self._to_goal[at], cells[at]], axis=1).astype(
            np.float64
        )
        middles = (
            np.stack(at[::-1], axis=1) * place.resolution
            + (place.origin_x, place.origin_y)
            + place.resolution / 2
        )
        return np.column_stack(
            [middles, parts, parts @ (scales.plan, scales.goal, scales.obstacle)]
        )

    def goal_distance(self, x: float, y: float) -> int | None:
        """Returns the steps from the cell at ``x, y`` [m] to the local goal; None outside the costmap."""
        cell = self._costmap.geometry.cell_at(x, y)
        return int(self._to_goal[cell]) if self._costmap.geometry.contains(cell) else None


def _scored(sample: NDArray[np.float64], result: NDArray[np.float64]) -> Scored:
    x, y, turn = (float(value) for value in sample)
    end = Pose(float(result[_X]), float(result[_Y]), float(result[_YAW]))
    return Scored(Velocity(x, y, turn), float(result[_COST]), end)
