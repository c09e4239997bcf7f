"""Local planning kernels: the footprint's cost, and the rollout of velocity samples.

The scores are trajectory rollout's (Gerkey and Konolige, Planning and Control in Unstructured Terrain,
2008) as base_local_planner computes them. A score's distance terms depend on a trajectory's end alone,
so they bound it from below: samples are checked against the costmap in the order of that bound, and
the search ends as soon as no bound is below the best score. The winner is the same, most checks fall away.
"""

import numpy as np
from numba import njit

from nav_bundle.kernels.costmap import INSCRIBED, LETHAL, line_between, next_cell

HIT = -1.0
UNREACHED = -2.0
UNCHECKED = -3.0

# Columns of ``results``.
COST, X, Y, YAW, BOUND = 0, 1, 2, 3, 4

SIGNATURES = {
    "footprint_cost": "i8(u1[:, ::1], f8, f8, f8, f8[:, ::1], f8, f8, f8)",
    "search": (
        "i8(u1[:, ::1], f8, f8, f8, i4[:, ::1], i4[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[::1],"
        " f8[:, ::1], f8[::1], f8[::1], b1, b1, f8[:, ::1], f8, f8[:, ::1])"
    ),
    "roll_out": "i8(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1])",
}


@njit
def _line_cost(costs, row_0, col_0, row_1, col_1):
    """Returns the highest cost along Bresenham's line, -1 if it meets a lethal cell, -2 an unknown one."""
    line = line_between(row_0, col_0, row_1, col_1)
    row, col, error_row, error_col = row_0, col_0, line[0] // 2, line[0] // 2
    highest = 0
    for _ in range(line[0] + 1):
        cost = costs[row, col]
        if cost >= LETHAL:
            return -1 if cost == LETHAL else -2
        highest = max(highest, np.int64(cost))
        row, col, error_row, error_col = next_cell(row, col, error_row, error_col, line)
    return highest


@njit
def footprint_cost(costs, origin_x, origin_y, resolution, footprint, x, y, yaw):
    """Returns the highest cost under the footprint's outline at a pose.

    -1 where it meets a lethal cell, -2 an unknown one, -3 the grid's edge.
    """
    rows, cols = costs.shape
    cosine = np.cos(yaw)
    sine = np.sin(yaw)
    count = footprint.shape[0]
    last_row = last_col = 0
    highest = 0
    for i in range(count + 1):
        j = i if i < count else 0
        vertex_x = x + cosine * footprint[j, 0] - sine * footprint[j, 1]
        vertex_y = y + sine * footprint[j, 0] + cosine * footprint[j, 1]
        row = int(np.floor((vertex_y - origin_y) / resolution))
        col = int(np.floor((vertex_x - origin_x) / resolution))
        if row < 0 or row >= rows or col < 0 or col >= cols:
            return -3
        if i > 0:
            cost = _line_cost(costs, last_row, last_col, row, col)
            if cost < 0:
                return cost
            highest = max(highest, cost)
        last_row, last_col = row, col
    return highest


@njit
def _steps(sample, horizon):
    """Returns how many poses of a sample are looked at: one per granularity of way or of turning speed."""
    speed = np.sqrt(sample[0] * sample[0] + sample[1] * sample[1])
    return max(1, int(max(speed * horizon[0] / horizon[1], abs(sample[2]) / horizon[2]) + 0.5))


@njit
def towards(value, wanted, change):
    """Returns ``value`` moved to ``wanted`` by at most ``change``."""
    if value < wanted:
        return min(value + change, wanted)
    return max(value - change, wanted)


@njit
def moved(x, y, yaw, vx, vy, turn, sample, acc, dt):
    """Returns pose and velocity ``dt`` later: the velocity first comes nearer to the sample, then moves the pose."""
    vx = towards(vx, sample[0], acc[0] * dt)
    vy = towards(vy, sample[1], acc[1] * dt)
    turn = towards(turn, sample[2], acc[2] * dt)
    cosine = np.cos(yaw)
    sine = np.sin(yaw)
    return x + (vx * cosine - vy * sine) * dt, y + (vx * sine + vy * cosine) * dt, yaw + turn * dt, vx, vy, turn


@njit
def _check(
    costs, origin_x, origin_y, resolution, to_plan, to_goal, footprint, pose, start, acc, sample, time, steps, reach
):
    """Follows one sample over the costmap: returns its highest cost, or HIT, or UNREACHED."""
    rows, cols = costs.shape
    x, y, yaw = pose[0], pose[1], pose[2]
    vx, vy, turn = start[0], start[1], start[2]
    dt = time / steps
    highest = 0
    for _ in range(steps):
        row = int(np.floor((y - origin_y) / resolution))
        col = int(np.floor((x - origin_x) / resolution))
        if row < 0 or row >= rows or col < 0 or col >= cols:
            return HIT
        cost = footprint_cost(costs, origin_x, origin_y, resolution, footprint, x, y, yaw)
        if cost < 0:
            return HIT
        highest = max(highest, max(cost, np.int64(costs[row, col])))
        if reach and (to_plan[row, col] >= rows * cols or to_goal[row, col] >= rows * cols):
            return UNREACHED
        x, y, yaw, vx, vy, turn = moved(x, y, yaw, vx, vy, turn, sample, acc, dt)
    return float(highest)


@njit
def follow(pose, start, acc, sample, time, steps, poses):
    """Writes the poses (x, y, yaw) of one sample into ``poses``; returns their number."""
    x, y, yaw = pose[0], pose[1], pose[2]
    vx, vy, turn = start[0], start[1], start[2]
    steps = min(steps, poses.shape[0])
    dt = time / steps
    for i in range(steps):
        poses[i, 0], poses[i, 1], poses[i, 2] = x, y, yaw
        x, y, yaw, vx, vy, turn = moved(x, y, yaw, vx, vy, turn, sample, acc, dt)
    return steps


def roll_out(pose, velocity, acc, sample, horizon, poses):
    """Writes the poses (x, y, yaw) of one sample into ``poses``; returns their number."""
    return follow(pose, velocity, acc, sample, horizon[0], _steps(sample, horizon), poses)


@njit
def _finish(pose, velocity, acc, sample, time, steps, looks, scored):
    """Writes the pose that is scored: the one after ``looks`` of the ``steps`` that a sample takes."""
    x, y, yaw = pose[0], pose[1], pose[2]
    vx, vy, turn = velocity[0], velocity[1], velocity[2]
    dt = time / steps
    for _ in range(looks):
        x, y, yaw, vx, vy, turn = moved(x, y, yaw, vx, vy, turn, sample, acc, dt)
    scored[0], scored[1], scored[2] = x, y, yaw


@njit
def _heading_difference(costs, origin_x, origin_y, resolution, plan, row, col, scored):
    """Returns the angle [rad] between a pose and the way to the farthest point of the plan that is in sight.

    A point is in sight if no cell on the line to it is inscribed, lethal or unknown; pi where none is.
    """
    rows, cols = costs.shape
    for i in range(plan.shape[0] - 1, -1, -1):
        plan_row = int(np.floor((plan[i, 1] - origin_y) / resolution))
        plan_col = int(np.floor((plan[i, 0] - origin_x) / resolution))
        if plan_row < 0 or plan_row >= rows or plan_col < 0 or plan_col >= cols:
            continue
        cost = _line_cost(costs, row, col, plan_row, plan_col)
        if cost < 0 or cost >= INSCRIBED:
            continue
        y = origin_y + (plan_row + 0.5) * resolution - scored[1]
        x = origin_x + (plan_col + 0.5) * resolution - scored[0]
        turn = np.arctan2(y, x) - scored[2]
        return abs(np.arctan2(np.sin(turn), np.cos(turn)))
    return np.pi


@njit
def cheapest(
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
    time,
    steps,
    obstacle_scale,
    reach,
    every,
    results,
):
    """Checks the samples marked UNCHECKED in the order of their bounds; returns the index of the cheapest, or -1.

    ``starts`` (n, 3) are the velocities they begin with, ``steps`` (n,) the numbers of looks within ``time`` [s].
    """
    best = -1
    while True:
        candidate = -1
        for i in range(samples.shape[0]):
            if results[i, COST] == UNCHECKED and (candidate < 0 or results[i, BOUND] < results[candidate, BOUND]):
                candidate = i
        if candidate < 0:
            return best
        if not every and best >= 0 and results[candidate, BOUND] > results[best, COST]:
            return best
        highest = _check(
            costs,
            origin_x,
            origin_y,
            resolution,
            to_plan,
            to_goal,
            footprint,
            pose,
            starts[candidate],
            acc,
            samples[candidate],
            time,
            steps[candidate],
            reach,
        )
        if highest < 0.0:
            results[candidate, COST] = highest
            continue
        results[candidate, COST] = results[candidate, BOUND] + obstacle_scale * highest
        if (
            best < 0
            or results[candidate, COST] < results[best, COST]
            or (results[candidate, COST] == results[best, COST] and candidate < best)
        ):
            best = candidate


def search(
    costs,
    origin_x,
    origin_y,
    resolution,
    to_plan,
    to_goal,
    footprint,
    pose,
    velocity,
    acc,
    samples,
    horizon,
    scales,
    reach,
    every,
    plan,
    heading_time,
    results,
):
    """Scores velocity samples; returns the index of the cheapest one that may be driven, -1 if none may.

    Args:
        costs: the local costmap.
        origin_x: corner of cell (0, 0) [m].
        origin_y: corner of cell (0, 0) [m].
        resolution: [m].
        to_plan: steps to the plan, from ``plan_distance.distance_grids``.
        to_goal: steps to the local goal, from ``plan_distance.distance_grids``.
        footprint: vertices (m, 2) [m] around the robot's origin.
        pose: x, y [m], yaw [rad] in the costmap's frame.
        velocity: forward, left [m/s], turn [rad/s] at the start.
        acc: limits of their change [m/s**2, rad/s**2].
        samples: velocities (n, 3) to try.
        horizon: time to look ahead [s], way between looks [m], turning speed per look [rad/s].
        scales: cost of a step to the plan and to the goal, of a unit of costmap cost, of a unit of heading difference.
        reach: refuse what crosses cells from which plan or goal cannot be reached.
        every: check every sample, also those that cannot win.
        plan: points (k, 2) [m] of the plan ahead, for scoring by heading; none for scoring without.
        heading_time: when poses are scored if there is a plan [s]; without one, their ends are.
        results: per sample cost (negative: why not), x, y, yaw of the scored end, and the bound.
    """
    rows, cols = costs.shape
    count = samples.shape[0]
    heading = plan.shape[0] > 0
    starts = np.empty((count, 3))
    steps = np.empty(count, np.int64)
    for i in range(count):
        result = results[i]
        starts[i, :] = velocity
        steps[i] = _steps(samples[i], horizon)
        looks = steps[i] - 1
        if heading:
            looks = min(looks, int(np.ceil(heading_time * steps[i] / horizon[0])))
        scored = result[X : YAW + 1]
        _finish(pose, velocity, acc, samples[i], horizon[0], steps[i], looks, scored)
        result[COST] = UNCHECKED
        row = int(np.floor((result[Y] - origin_y) / resolution))
        col = int(np.floor((result[X] - origin_x) / resolution))
        if row < 0 or row >= rows or col < 0 or col >= cols:
            result[COST] = HIT
        elif reach and (to_plan[row, col] >= rows * cols or to_goal[row, col] >= rows * cols):
            result[COST] = UNREACHED
        else:
            result[BOUND] = scales[0] * to_plan[row, col] + scales[1] * to_goal[row, col]
            if heading:
                place = (costs, origin_x, origin_y, resolution)
                result[BOUND] += scales[3] * _heading_difference(*place, plan, row, col, scored)
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
        scales[2],
        reach and not heading,
        every,
        results,
    )
