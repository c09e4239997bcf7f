"""Velocity samples scored as dwa_local_planner does, one kernel call a question."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core import kernel
from nav_bundle.core.local_planner import Situation, Velocity
from nav_bundle.core.rollout import Horizon, Rollout, Scales


@dataclass(frozen=True)
class NoseScales:
    """Cost of a cell's step of the nose to the plan and to its goal, and of a unit of turning speed [s/rad]."""

    alignment: float
    front: float
    twirling: float


class DynamicWindow(Rollout):
    """A rollout that also looks at the robot's nose, a point ``nose`` [m] in front of it.

    The nose is drawn along the plan, and to a point beyond the plan's end as seen from the robot. Unless
    ``accelerating``, a sample begins with its own velocity: it was chosen from what can be reached in one cycle.
    ``is_free`` goes on accelerating in any case.
    """

    def __init__(
        self, acc: Velocity, horizon: Horizon, scales: Scales, nose_scales: NoseScales, nose: float, accelerating: bool
    ) -> None:
        super().__init__(acc, horizon, scales)
        each = (scales.plan, scales.goal, scales.obstacle, nose_scales.alignment, nose_scales.front)
        self._all_scales = np.array([*each, nose_scales.twirling], np.float64)
        self._alignment = nose_scales.alignment
        self._nose, self._accelerating = nose, accelerating
        self._to_front = np.empty((0, 0), np.int32)

    def begin_window(self, situation: Situation, plan: NDArray[np.float64], aligned: bool) -> bool:
        """Takes a moment like ``begin``; the nose keeps to the plan only where ``aligned``."""
        if not self.begin(situation, plan):
            return False
        self._all_scales[3] = self._alignment if aligned else 0.0
        if self._to_front.shape != self._to_plan.shape:
            self._to_front = np.empty_like(self._to_plan)
        points = np.ascontiguousarray(plan[:, :2])
        pose = situation.pose
        towards = math.atan2(points[-1, 1] - pose.y, points[-1, 0] - pose.x)
        points[-1] += self._nose * math.cos(towards), self._nose * math.sin(towards)
        outline = situation.costmap.footprint.outline(pose)
        cells = situation.costmap.cells
        return bool(kernel.goal_grid(cells, *self._place, points, outline, self._to_front, self._queue) > 0)

    def _search(
        self, samples: NDArray[np.float64], reach: bool, every: bool, time: float = math.inf
    ) -> tuple[int, NDArray[np.float64]]:
        if not reach:
            return super()._search(samples, reach, every, time)
        results = np.empty((len(samples), 5))
        best = kernel.score(
            self._costmap.cells,
            *self._place,
            self._to_plan,
            self._to_goal,
            self._to_front,
            self._costmap.footprint.vertices,
            self._pose,
            self._velocity,
            self._acc,
            samples,
            self._until(time),
            self._all_scales,
            self._nose,
            self._accelerating,
            every,
            results,
        )
        return int(best), results

    def poses(self, velocity: Velocity, time: float = math.inf) -> NDArray[np.float64]:
        """Returns the poses (n, 3) that ``velocity`` leads through within ``time`` [s], the horizon's at most."""
        poses = np.empty((256, 3))
        sample = np.array([velocity.x, velocity.y, velocity.turn], np.float64)
        motion = (self._pose, self._velocity, self._acc)
        count = kernel.trace(*motion, sample, self._until(time), self._accelerating, poses)
        return poses[:count]
