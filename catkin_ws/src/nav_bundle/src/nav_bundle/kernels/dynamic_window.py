"""Dynamic window kernel: velocity samples scored by dwa_local_planner's critics (Fox, Burgard and Thrun, 1997).

All critics but the obstacles' look at a trajectory's end alone, so they bound its score from below; see
``kernels/trajectory.py``, whose search this one shares.
"""

import numpy as np
from numba import njit

from nav_bundle.kernels.trajectory import BOUND, COST, HIT, UNCHECKED, UNREACHED, X, Y, cheapest, follow, moved

# Positions in ``scales``.
PLAN, GOAL, OBSTACLE, ALIGNMENT, FRONT, TWIRLING = 0, 1, 2, 3, 4, 5

SIGNATURES = {
    "score": (
        "i8(u1[:, ::1], f8, f8, f8, i4[:, ::1], i4[:, ::1], i4[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[::1],"
        " f8[:, ::1], f8[::1], f8[::1], f8, b1, b1, f8[:, ::1])"
    ),
    "trace": "i8(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], b1, f8[:, ::1])",
}


@njit
def _looks(sample, horizon):
    """Returns how many poses of a sample are looked at: one per granularity of way or of turn."""
    way = np.sqrt(sample[0] * sample[0] + sample[1] * sample[1]) * horizon[0]
    return max(1, int(np.ceil(max(way / horizon[1], abs(sample[2]) * horizon[0] / horizon[2]))))


@njit
def _finish(costs, origin_x, origin_y, resolution, pose, start, acc, sample, time, steps, nose, scored):
    """Writes the last pose that is looked at; returns the nose's (row, col) there, (-1, -1) if it left the grid."""
    rows, cols = costs.shape
    x, y, yaw = pose[0], pose[1], pose[2]
    vx, vy, turn = start[0], start[1], start[2]
    dt = time / steps
    row = col = -1
    for _ in range(steps):
        scored[0], scored[1], scored[2] = x, y, yaw
        row = int(np.floor((y + nose * np.sin(yaw) - origin_y) / resolution))
        col = int(np.floor((x + nose * np.cos(yaw) - origin_x) / resolution))
        if row < 0 or row >= rows or col < 0 or col >= cols:
            return -1, -1
        x, y, yaw, vx, vy, turn = moved(x, y, yaw, vx, vy, turn, sample, acc, dt)
    return row, col


def score(
    costs,
    origin_x,
    origin_y,
    resolution,
    to_plan,
    to_goal,
    to_front,
    footprint,
    pose,
    velocity,
    acc,
    samples,
    horizon,
    scales,
    nose,
    accelerating,
    every,
    results,
):
    """Scores velocity samples; returns the index of the cheapest one that may be driven, -1 if none may.

    Args:
        costs: the local costmap.
        origin_x: corner of cell (0, 0) [m].
        origin_y: corner of cell (0, 0) [m].
        resolution: [m].
        to_plan: steps to the plan, from ``plan_distance.distance_grids``.
        to_goal: steps to the local goal.
        to_front: steps to where the nose shall be at the local goal.
        footprint: vertices (m, 2) [m] around the robot's origin.
        pose: x, y [m], yaw [rad] in the costmap's frame.
        velocity: forward, left [m/s], turn [rad/s] now.
        acc: limits of their change [m/s**2, rad/s**2].
        samples: velocities (n, 3) to try.
        horizon: time to look ahead [s], way [m] and turn [rad] between looks.
        scales: cost of a step to the plan and to the goal, of a unit of costmap cost, of a step of the nose to the
            plan and to its goal, of a unit of turning speed.
        nose: how far [m] in front of its origin the robot's nose is.
        accelerating: samples begin with ``velocity`` and reach theirs by ``acc``; else they begin with theirs.
        every: check every sample, also those that cannot win.
        results: per sample cost (negative: why not), x, y, yaw of the scored end, and the bound.
    """
    rows, cols = costs.shape
    count = samples.shape[0]
    starts = np.empty((count, 3))
    steps = np.empty(count, np.int64)
    for i in range(count):
        sample = samples[i]
        result = results[i]
        starts[i, :] = velocity if accelerating else sample
        steps[i] = _looks(sample, horizon)
        place = (costs, origin_x, origin_y, resolution)
        nose_row, nose_col = _finish(
            *place, pose, starts[i], acc, sample, horizon[0], steps[i], nose, result[X : X + 3]
        )
        row = int(np.floor((result[Y] - origin_y) / resolution))
        col = int(np.floor((result[X] - origin_x) / resolution))
        if nose_row < 0 or row < 0 or row >= rows or col < 0 or col >= cols:
            result[COST] = HIT
        elif to_plan[row, col] >= rows * cols or to_goal[row, col] >= rows * cols:
            result[COST] = UNREACHED
        else:
            result[COST] = UNCHECKED
            result[BOUND] = (
                scales[PLAN] * to_plan[row, col]
                + scales[GOAL] * to_goal[row, col]
                + scales[ALIGNMENT] * to_plan[nose_row, nose_col]
                + scales[FRONT] * to_front[nose_row, nose_col]
                + scales[TWIRLING] * abs(sample[2])
            )
    return cheapest(
        costs,
        origin_x,
        origin_y,
        resolution,
        to_plan,
        to_goal,
        footprint,
        pose,
        starts,
        acc,
        samples,
        horizon[0],
        steps,
        scales[OBSTACLE],
        True,
        every,
        results,
    )


def trace(pose, velocity, acc, sample, horizon, accelerating, poses):
    """Writes the poses (x, y, yaw) of one sample into ``poses``; returns their number."""
    start = velocity if accelerating else sample
    return follow(pose, start, acc, sample, horizon[0], _looks(sample, horizon), poses)
