"""Dynamic window kernel: scores velocity samples by dwa_local_planner's critics (Fox, Burgard and Thrun, 1997).

All critics except the obstacle critic depend only on a trajectory's end, so their sum is a lower bound of its score.
The search is shared with ``trajectory_kernel.py``.
"""

from typing import NamedTuple

import numpy as np

from nav_bundle.control.plan_distance_kernel import Steps
from nav_bundle.control.trajectory_kernel import (
    BOUND,
    COST,
    HIT,
    UNCHECKED,
    UNREACHED,
    Ground,
    Horizon,
    Motion,
    Scales,
    Vector,
    X,
    Y,
    cheapest,
    follow,
    is_reached,
    moved,
)
from nav_bundle.costmap.costmap_kernel import cell_at
from pioneer_kernels.declaration import Array2, kernel, njit


class Nose(NamedTuple):
    """The robot's nose: ``length`` [m] in front of it, steps to its target beyond the local goal, and weights.

    ``alignment`` and ``front`` are the costs per step from the nose to the plan and to its target; ``twirling`` is the
    cost per unit of turning speed [s/rad].
    """

    length: float
    to_front: Steps
    alignment: float
    front: float
    twirling: float


@njit
def _looks(sample, horizon):
    """Returns the number of poses checked for a sample: one per granularity of distance or angle."""
    way = np.sqrt(sample[0] * sample[0] + sample[1] * sample[1]) * horizon.time
    return max(
        1, int(np.ceil(max(way / horizon.way, abs(sample[2]) * horizon.time / horizon.turn)))
    )


@njit
def _finish(ground, motion, start, sample, time, steps, nose, scored):
    """Writes the last checked pose; returns the nose's (row, col) there, (-1, -1) if the nose left the grid."""
    rows, cols = ground.costs.shape
    x, y, yaw = motion.pose[0], motion.pose[1], motion.pose[2]
    vx, vy, turn = start[0], start[1], start[2]
    dt = time / steps
    row = col = -1
    for _ in range(steps):
        scored[0], scored[1], scored[2] = x, y, yaw
        row, col = cell_at(ground.place, x + nose * np.cos(yaw), y + nose * np.sin(yaw))
        if row < 0 or row >= rows or col < 0 or col >= cols:
            return -1, -1
        x, y, yaw, vx, vy, turn = moved(x, y, yaw, vx, vy, turn, sample, motion.acc, dt)
    return row, col


@kernel
def score(
    ground: Ground,
    nose: Nose,
    motion: Motion,
    samples: Array2[np.float64],
    horizon: Horizon,
    scales: Scales,
    accelerating: bool,
    every: bool,
    limit: float,
    results: Array2[np.float64],
) -> int:
    """Scores velocity samples; returns the index of the cheapest valid one, -1 if none is valid.

    Args:
        ground: costmap and the steps written by ``plan_distance.distance_grids``.
        nose: the robot's nose.
        motion: the robot's motion at the start.
        samples: velocities (n, 3) to try.
        horizon: simulation horizon; its ``turn`` is an angle [rad] here.
        scales: weights of the costs; the heading weight is ignored.
        accelerating: samples accelerate from the robot's velocity; otherwise they start at their own velocity.
        every: check every sample, even those that cannot be the cheapest.
        limit: samples that cost more are invalid.
        results: per sample: cost (negative: why invalid), x, y, yaw of the scored end, and the bound.
    """
    rows, cols = ground.costs.shape
    count = samples.shape[0]
    starts = np.empty((count, 3))
    steps = np.empty(count, np.int64)
    for i in range(count):
        sample = samples[i]
        result = results[i]
        starts[i, :] = motion.velocity if accelerating else sample
        steps[i] = _looks(sample, horizon)
        scored = result[X : X + 3]
        nose_row, nose_col = _finish(
            ground, motion, starts[i], sample, horizon.time, steps[i], nose.length, scored
        )
        row, col = cell_at(ground.place, result[X], result[Y])
        if nose_row < 0 or row < 0 or row >= rows or col < 0 or col >= cols:
            result[COST] = HIT
        elif not is_reached(ground, row, col):
            result[COST] = UNREACHED
        else:
            result[COST] = UNCHECKED
            result[BOUND] = (
                scales.plan * ground.to_plan[row, col]
                + scales.goal * ground.to_goal[row, col]
                + nose.alignment * ground.to_plan[nose_row, nose_col]
                + nose.front * nose.to_front[nose_row, nose_col]
                + nose.twirling * abs(sample[2])
            )
    return cheapest(
        ground, motion, starts, samples, horizon.time, steps, scales, True, every, limit, results
    )


@kernel
def trace(
    motion: Motion, sample: Vector, horizon: Horizon, accelerating: bool, poses: Array2[np.float64]
) -> int:
    """Writes the poses (x, y, yaw) of one sample into ``poses``; returns their number."""
    start = motion.velocity if accelerating else sample
    return follow(motion, start, sample, horizon.time, _looks(sample, horizon), poses)
