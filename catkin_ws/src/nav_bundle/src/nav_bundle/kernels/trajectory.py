"""Local planning kernels: distances to the plan and to the local goal, and the rollout of velocity samples.

The scores are trajectory rollout's (Gerkey and Konolige, Planning and Control in Unstructured Terrain,
2008) as base_local_planner computes them. A score's distance terms depend on a trajectory's end alone,
so they bound it from below: samples are checked against the costmap in the order of that bound, and
the search ends as soon as no bound is below the best score. The winner is the same, most checks fall away.
"""

import numpy as np
from numba import njit

from nav_bundle.kernels.costmap import fill_polygon

INSCRIBED = 253
LETHAL = 254
UNKNOWN = 255

HIT = -1.0
UNREACHED = -2.0
UNCHECKED = -3.0

# Columns of ``results``.
COST, X, Y, YAW, BOUND = 0, 1, 2, 3, 4

SIGNATURES = {
    "distance_grids": "i8(u1[:, ::1], f8, f8, f8, f8[:, ::1], f8[:, ::1], i4[:, ::1], i4[:, ::1], i4[::1])",
    "footprint_cost": "i8(u1[:, ::1], f8, f8, f8, f8[:, ::1], f8, f8, f8)",
    "search": (
        "i8(u1[:, ::1], f8, f8, f8, i4[:, ::1], i4[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[::1],"
        " f8[:, ::1], f8[::1], f8[::1], b1, b1, f8[:, ::1])"
    ),
    "roll_out": "i8(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1])",
}


@njit
def _plan_cells(costs, origin_x, origin_y, resolution, plan, cells):
    """Writes the flat indices of the known cells that the plan crosses on its first way through the grid.

    Returns their number; at most one entry per cell of ``cells``.
    """
    rows, cols = costs.shape
    count = 0
    for i in range(plan.shape[0]):
        before = i - 1 if i > 0 else 0
        dx = plan[i, 0] - plan[before, 0]
        dy = plan[i, 1] - plan[before, 1]
        parts = max(1, int(np.ceil(np.sqrt(dx * dx + dy * dy) / resolution)))
        for part in range(1, parts + 1):
            x = plan[before, 0] + dx * part / parts
            y = plan[before, 1] + dy * part / parts
            row = int(np.floor((y - origin_y) / resolution))
            col = int(np.floor((x - origin_x) / resolution))
            if row < 0 or row >= rows or col < 0 or col >= cols or costs[row, col] == UNKNOWN:
                if count > 0:
                    return count
                continue
            cell = row * cols + col
            if (count == 0 or cells[count - 1] != cell) and count < cells.shape[0]:
                cells[count] = cell
                count += 1
    return count


@njit
def _flood(costs, inside, distance, queue, count):
    """Fills ``distance`` by steps between edge neighbours from the ``count`` cells queued with distance 0.

    Obstacles, except under the robot, get the number of cells; what cannot be reached one more.
    """
    rows, cols = costs.shape
    head = 0
    while head < count:
        cell = queue[head]
        head += 1
        row = cell // cols
        col = cell - row * cols
        onwards = distance[row, col] + 1
        for d_row, d_col in ((0, -1), (0, 1), (-1, 0), (1, 0)):
            r = row + d_row
            c = col + d_col
            if r < 0 or r >= rows or c < 0 or c >= cols or distance[r, c] != rows * cols + 1:
                continue
            if costs[r, c] >= INSCRIBED and inside[r, c] == 0:
                distance[r, c] = rows * cols
                continue
            distance[r, c] = onwards
            queue[count] = r * cols + c
            count += 1


def distance_grids(costs, origin_x, origin_y, resolution, plan, outline, to_plan, to_goal, queue):
    """Fills the two grids that trajectories are scored on; returns how many cells the plan crosses, 0 if none.

    Args:
        costs: the local costmap.
        origin_x: corner of cell (0, 0) [m].
        origin_y: corner of cell (0, 0) [m].
        resolution: [m].
        plan: points (n, 2) [m] in the costmap's frame.
        outline: the footprint's vertices (m, 2) [m] at the robot's pose.
        to_plan: steps to the plan, for every cell.
        to_goal: steps to the plan's last cell inside the costmap.
        queue: room for one entry per cell.
    """
    rows, cols = costs.shape
    inside = np.zeros((rows, cols), np.uint8)
    fill_polygon(inside, origin_x, origin_y, resolution, outline, np.uint8(1))
    to_plan[:, :] = rows * cols + 1
    to_goal[:, :] = rows * cols + 1
    crossed = np.empty(rows * cols, np.int32)
    crossings = _plan_cells(costs, origin_x, origin_y, resolution, plan, crossed)
    if crossings == 0:
        return 0
    count = 0
    for i in range(crossings):
        row = crossed[i] // cols
        col = crossed[i] - row * cols
        if to_plan[row, col] != 0:
            to_plan[row, col] = 0
            queue[count] = crossed[i]
            count += 1
    _flood(costs, inside, to_plan, queue, count)
    goal = crossed[crossings - 1]
    to_goal[goal // cols, goal % cols] = 0
    queue[0] = goal
    _flood(costs, inside, to_goal, queue, 1)
    return crossings


@njit
def _line_cost(costs, row_0, col_0, row_1, col_1):
    """Returns the highest cost along Bresenham's line, -1 if it meets a lethal cell, -2 an unknown one."""
    d_row = abs(row_1 - row_0)
    d_col = abs(col_1 - col_0)
    step_row = 1 if row_1 > row_0 else -1
    step_col = 1 if col_1 > col_0 else -1
    length = max(d_row, d_col)
    error_row = length // 2
    error_col = length // 2
    row = row_0
    col = col_0
    highest = 0
    for _ in range(length + 1):
        cost = costs[row, col]
        if cost >= LETHAL:
            return -1 if cost == LETHAL else -2
        highest = max(highest, np.int64(cost))
        error_row -= d_row
        if error_row < 0:
            error_row += length
            row += step_row
        error_col -= d_col
        if error_col < 0:
            error_col += length
            col += step_col
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
def _towards(value, wanted, change):
    if value < wanted:
        return min(value + change, wanted)
    return max(value - change, wanted)


@njit
def _check(
    costs, origin_x, origin_y, resolution, to_plan, to_goal, footprint, pose, velocity, acc, sample, horizon, reach
):
    """Follows one sample over the costmap: returns its highest cost, or HIT, or UNREACHED."""
    rows, cols = costs.shape
    x, y, yaw = pose[0], pose[1], pose[2]
    vx, vy, turn = velocity[0], velocity[1], velocity[2]
    steps = _steps(sample, horizon)
    dt = horizon[0] / steps
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
        vx = _towards(vx, sample[0], acc[0] * dt)
        vy = _towards(vy, sample[1], acc[1] * dt)
        turn = _towards(turn, sample[2], acc[2] * dt)
        cosine = np.cos(yaw)
        sine = np.sin(yaw)
        x += (vx * cosine - vy * sine) * dt
        y += (vx * sine + vy * cosine) * dt
        yaw += turn * dt
    return float(highest)


def roll_out(pose, velocity, acc, sample, horizon, poses):
    """Writes the poses (x, y, yaw) of one sample into ``poses``; returns their number."""
    x, y, yaw = pose[0], pose[1], pose[2]
    vx, vy, turn = velocity[0], velocity[1], velocity[2]
    steps = min(_steps(sample, horizon), poses.shape[0])
    dt = horizon[0] / steps
    for i in range(steps):
        poses[i, 0], poses[i, 1], poses[i, 2] = x, y, yaw
        vx = _towards(vx, sample[0], acc[0] * dt)
        vy = _towards(vy, sample[1], acc[1] * dt)
        turn = _towards(turn, sample[2], acc[2] * dt)
        cosine = np.cos(yaw)
        sine = np.sin(yaw)
        x += (vx * cosine - vy * sine) * dt
        y += (vx * sine + vy * cosine) * dt
        yaw += turn * dt
    return steps


@njit
def _finish(pose, velocity, acc, sample, horizon, scored):
    """Writes where a sample ends, and the last pose that is scored, the one before the last step."""
    x, y, yaw = pose[0], pose[1], pose[2]
    vx, vy, turn = velocity[0], velocity[1], velocity[2]
    steps = _steps(sample, horizon)
    dt = horizon[0] / steps
    for _ in range(steps):
        scored[0], scored[1], scored[2] = x, y, yaw
        vx = _towards(vx, sample[0], acc[0] * dt)
        vy = _towards(vy, sample[1], acc[1] * dt)
        turn = _towards(turn, sample[2], acc[2] * dt)
        cosine = np.cos(yaw)
        sine = np.sin(yaw)
        x += (vx * cosine - vy * sine) * dt
        y += (vx * sine + vy * cosine) * dt
        yaw += turn * dt


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
    results,
):
    """Scores velocity samples; returns the index of the cheapest one that may be driven, -1 if none may.

    Args:
        costs: the local costmap.
        origin_x: corner of cell (0, 0) [m].
        origin_y: corner of cell (0, 0) [m].
        resolution: [m].
        to_plan: steps to the plan, from ``distance_grids``.
        to_goal: steps to the local goal, from ``distance_grids``.
        footprint: vertices (m, 2) [m] around the robot's origin.
        pose: x, y [m], yaw [rad] in the costmap's frame.
        velocity: forward, left [m/s], turn [rad/s] at the start.
        acc: limits of their change [m/s**2, rad/s**2].
        samples: velocities (n, 3) to try.
        horizon: time to look ahead [s], way between looks [m], turning speed per look [rad/s].
        scales: cost of a step to the plan, of a step to the goal, of a unit of costmap cost.
        reach: refuse what crosses cells from which plan or goal cannot be reached.
        every: check every sample, also those that cannot win.
        results: per sample cost (negative: why not), x, y, yaw of the scored end, and the bound.
    """
    rows, cols = costs.shape
    count = samples.shape[0]
    for i in range(count):
        result = results[i]
        _finish(pose, velocity, acc, samples[i], horizon, result[X : YAW + 1])
        result[COST] = UNCHECKED
        row = int(np.floor((result[Y] - origin_y) / resolution))
        col = int(np.floor((result[X] - origin_x) / resolution))
        if row < 0 or row >= rows or col < 0 or col >= cols:
            result[COST] = HIT
        elif reach and (to_plan[row, col] >= rows * cols or to_goal[row, col] >= rows * cols):
            result[COST] = UNREACHED
        else:
            result[BOUND] = scales[0] * to_plan[row, col] + scales[1] * to_goal[row, col]
    best = -1
    while True:
        candidate = -1
        for i in range(count):
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
            velocity,
            acc,
            samples[candidate],
            horizon,
            reach,
        )
        if highest < 0.0:
            results[candidate, COST] = highest
            continue
        results[candidate, COST] = results[candidate, BOUND] + scales[2] * highest
        if (
            best < 0
            or results[candidate, COST] < results[best, COST]
            or (results[candidate, COST] == results[best, COST] and candidate < best)
        ):
            best = candidate
