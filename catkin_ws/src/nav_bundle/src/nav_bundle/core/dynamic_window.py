"""Scores velocity samples as dwa_local_planner does, all samples in one kernel call."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core.clearance import Clearance
from nav_bundle.core.local_planner import Situation, Velocity
from nav_bundle.core.rollout import Rollout
from nav_bundle.kernels.dynamic_window import Nose, score, trace
from nav_bundle.kernels.plan_distance import goal_grid
from nav_bundle.kernels.trajectory import Horizon, Scales


@dataclass(frozen=True)
class NoseScales:
    """Weights: nose's distance to the plan and to its goal [1/cell], and turning speed [s/rad]."""

    alignment: float
    front: float
    twirling: float


class DynamicWindow(Rollout):
    """A rollout that also scores the robot's nose, a point ``nose`` [m] in front of the robot.

    The nose is attracted to the plan, and to a point beyond the plan's end as seen from the robot. Unless
    ``accelerating``, a sample starts at its own velocity, since it was chosen from those reachable in one cycle.
    ``is_free`` always accelerates.
    """

    def __init__(
        self,
        acc: Velocity,
        horizon: Horizon,
        scales: Scales,
        clearance: Clearance,
        nose_scales: NoseScales,
        nose: float,
        accelerating: bool,
    ) -> None:
        super().__init__(acc, horizon, scales, clearance)
        self._nose = Nose(nose, self._to_plan, nose_scales.alignment, nose_scales.front, nose_scales.twirling)
        self._alignment, self._accelerating = nose_scales.alignment, accelerating

    def begin_window(self, situation: Situation, plan: NDArray[np.float64], aligned: bool) -> bool:
        """Starts a cycle like ``begin``; the nose follows the plan only if ``aligned``."""
        if not self.begin(situation, plan):
            return False
        to_front = self._nose.to_front
        if to_front.shape != self._to_plan.shape:
            to_front = np.empty_like(self._to_plan)
        self._nose = self._nose._replace(to_front=to_front, alignment=self._alignment if aligned else 0.0)
        points = np.ascontiguousarray(plan[:, :2])
        pose = situation.pose
        towards = math.atan2(points[-1, 1] - pose.y, points[-1, 0] - pose.x)
        points[-1] += self._nose.length * math.cos(towards), self._nose.length * math.sin(towards)
        return goal_grid(self._floor, points, to_front, self._queue) > 0

    def _search(
        self, samples: NDArray[np.float64], reach: bool, every: bool, time: float = math.inf, limit: float = math.inf
    ) -> tuple[int, NDArray[np.float64]]:
        if not reach:
            return super()._search(samples, reach, every, time, limit)
        results = np.empty((len(samples), 5))
        moment = (self._ground, self._nose, self._motion, samples, self._until(time), self._scales)
        return score(*moment, self._accelerating, every, limit, results), results

    def poses(self, velocity: Velocity, time: float = math.inf) -> NDArray[np.float64]:
        """Returns the poses (n, 3) along ``velocity`` within ``time`` [s], at most the horizon."""
        poses = np.empty((256, 3))
        sample = np.array([velocity.x, velocity.y, velocity.turn], np.float64)
        return poses[: trace(self._motion, sample, self._until(time), self._accelerating, poses)]
