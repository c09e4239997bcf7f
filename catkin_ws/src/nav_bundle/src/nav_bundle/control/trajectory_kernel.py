"""Local planning kernels: footprint cost and rollout of velocity samples.

The scores are those of trajectory rollout (Gerkey and Konolige, Planning and Control in Unstructured Terrain, 2008)
as in base_local_planner. A score's distance terms depend only on a trajectory's end, so they are a lower bound of the
score. Samples are checked against the costmap in the order of this bound. The search ends as soon as no bound is below
the best score, and a check ends as soon as its own cost exceeds the best score. The result is the same as that of a
full search, with far fewer checks.
"""

from typing import NamedTuple

import numpy as np

from nav_bundle.control.plan_distance_kernel import Steps
from nav_bundle.costmap.costmap_kernel import (
    INSCRIBED,
    Costs,
    Place,
    Points,
    cell_at,
)
from nav_bundle.costmap.footprint_kernel import line_cost, outline_cost
from pioneer_kernels.declaration import Array1, Array2, kernel, njit

Vector = Array1[np.float64]
"""x, y and yaw (or turning speed), shape (3,)."""

HIT = -1.0
UNREACHED = -2.0
UNCHECKED = -3.0
DEAR = -4.0

_STRAIGHT = 1.0e-9
"""Half the turn between two poses below which a trajectory counts as straight [rad]."""

# Columns of ``results``.
COST, X, Y, YAW, BOUND = 0, 1, 2, 3, 4


class Ground(NamedTuple):
    """Input for scoring: the local costmap, steps to the plan and to the local goal, and the footprint.

    The footprint's vertices are relative to the robot. ``prices`` is the clearance penalty by cell cost, shape (256,);
    the highest of those at the ``ends`` [m] along the robot's x axis counts. ``allowed`` is the penalty that is free,
    by distance from the robot in cells; if it is empty, clearance has no cost.
    """

    costs: Costs
    place: Place
    to_plan: Steps
    to_goal: Steps
    footprint: Points
    prices: Array1[np.float64]
    allowed: Array1[np.float64]
    ends: Array1[np.float64]


class Motion(NamedTuple):
    """Pose [m, rad] in the costmap's frame, velocity [m/s, rad/s], and acceleration limits [m/s², rad/s²]."""

    pose: Vector
    velocity: Vector
    acc: Vector


class Horizon(NamedTuple):
    """Simulation horizon [s] of samples, and their granularity: distance [m] and turning speed [rad/s] per pose.

    ``heading`` [s] is the time at which a sample is scored if headings count; otherwise it is scored at its end.
    """

    time: float
    way: float
    turn: float
    heading: float = 0.0


class Scales(NamedTuple):
    """Weights: per step to the plan and to the local goal, per unit of costmap cost, per radian of heading."""

    plan: float
    goal: float
    obstacle: float
    heading: float = 0.0


@njit
def _steps(sample, horizon):
    """Returns the number of poses checked for a sample: one per granularity of distance or turning speed."""
    speed = np.sqrt(sample[0] * sample[0] + sample[1] * sample[1])
    return max(1, int(max(speed * horizon.time / horizon.way, abs(sample[2]) / horizon.turn) + 0.5))


@njit
def towards(value, wanted, change):
    """Returns ``value`` moved towards ``wanted`` by at most ``change``."""
    if value < wanted:
        return min(value + change, wanted)
    return max(value - change, wanted)


@njit
def moved(x, y, yaw, vx, vy, turn, sample, acc, dt):
    """Returns pose and velocity ``dt`` later: first accelerates towards the sample, then moves the pose."""
    vx = towards(vx, sample[0], acc[0] * dt)
    vy = towards(vy, sample[1], acc[1] * dt)
    turn = towards(turn, sample[2], acc[2] * dt)
    cosine = np.cos(yaw)
    sine = np.sin(yaw)
    return (
        x + (vx * cosine - vy * sine) * dt,
        y + (vx * sine + vy * cosine) * dt,
        yaw + turn * dt,
        vx,
        vy,
        turn,
    )


@njit
def is_reached(ground, row, col):
    """Returns whether the cell is connected to the plan and to the local goal in the distance grids."""
    cells = ground.costs.size
    return ground.to_plan[row, col] < cells and ground.to_goal[row, col] < cells


@kernel
def plan_prices(
    costs: Costs,
    place: Place,
    prices: Array1[np.float64],
    plan: Array2[np.float64],
    asides: Array1[np.float64],
    blur: int,
    x: float,
    y: float,
    found: Array1[np.float64],
) -> None:
    """Writes the clearance penalties that a plan cannot avoid into ``found``, by distance from (x, y) in cells.

    At a traversable point of the plan (n, 2 or more; every second one is used), this is the lowest penalty at
    ``asides`` [m] across the plan. The highest penalty of the points applies within ``blur`` cells of its distance.
    """
    rows, cols = costs.shape
    last = (plan.shape[0] - 1) // 2
    count = found.shape[0]
    found[:] = 0.0
    for i in range(last + 1):
        point, before, after = plan[2 * i], plan[2 * max(i - 2, 0)], plan[2 * min(i + 2, last)]
        along_x = after[0] - before[0]
        along_y = after[1] - before[1]
        length = max(np.hypot(along_x, along_y), 1.0e-9)
        away = int(np.hypot(point[0] - x, point[1] - y) / place.resolution)
        row, col = cell_at(place, point[0], point[1])
        if (
            away >= count
            or row < 0
            or row >= rows
            or col < 0
            or col >= cols
            or costs[row, col] >= INSCRIBED
        ):
            continue
        least = prices[costs[row, col]]
        for aside in asides:
            row, col = cell_at(
                place, point[0] - aside * along_y / length, point[1] + aside * along_x / length
            )
            if 0 <= row < rows and 0 <= col < cols:
                least = min(least, prices[costs[row, col]])
        for near in range(max(away - blur, 0), min(away + blur + 1, count)):
            found[near] = max(found[near], least)


@njit
def _price(ground, x, y, cosine, sine):
    """Returns the highest clearance penalty of the robot's ``ends`` at a pose."""
    rows, cols = ground.costs.shape
    highest = 0.0
    for along in ground.ends:
        row, col = cell_at(ground.place, x + along * cosine, y + along * sine)
        if 0 <= row < rows and 0 <= col < cols:
            highest = max(highest, ground.prices[ground.costs[row, col]])
    return highest


@njit
def _check(ground, motion, start, sample, time, steps, scales, reach, bound, limit):
    """Simulates one sample on the costmap; returns ``bound`` plus its obstacle costs, or why it is invalid.

    The reason is HIT, UNREACHED, or, as soon as the sum exceeds ``limit``, DEAR.
    """
    rows, cols = ground.costs.shape
    x, y, yaw = motion.pose[0], motion.pose[1], motion.pose[2]
    vx, vy, turn = start[0], start[1], start[2]
    dt = time / steps
    highest = 0
    near = 0.0
    bins = ground.allowed.shape[0]
    for _ in range(steps):
        row, col = cell_at(ground.place, x, y)
        if row < 0 or row >= rows or col < 0 or col >= cols:
            return HIT
        cosine = np.cos(yaw)
        sine = np.sin(yaw)
        if bins > 0:
            away = np.hypot(x - motion.pose[0], y - motion.pose[1]) / ground.place.resolution
            near += max(
                0.0, _price(ground, x, y, cosine, sine) - ground.allowed[min(int(away), bins - 1)]
            )
        highest = max(highest, np.int64(ground.costs[row, col]))
        if bound + (scales.obstacle * highest + near / steps) > limit:
            return DEAR
        cost = outline_cost(ground.costs, ground.place, ground.footprint, x, y, cosine, sine)
        if cost < 0:
            return HIT
        highest = max(highest, cost)
        if reach and not is_reached(ground, row, col):
            return UNREACHED
        x, y, yaw, vx, vy, turn = moved(x, y, yaw, vx, vy, turn, sample, motion.acc, dt)
    cost = bound + (scales.obstacle * highest + near / steps)
    return DEAR if cost > limit else cost


@njit
def follow(motion, start, sample, time, steps, poses):
    """Writes the poses (x, y, yaw) of one sample into ``poses``; returns their number."""
    x, y, yaw = motion.pose[0], motion.pose[1], motion.pose[2]
    vx, vy, turn = start[0], start[1], start[2]
    steps = min(steps, poses.shape[0])
    dt = time / steps
    for i in range(steps):
        poses[i, 0], poses[i, 1], poses[i, 2] = x, y, yaw
        x, y, yaw, vx, vy, turn = moved(x, y, yaw, vx, vy, turn, sample, motion.acc, dt)
    return steps


@kernel
def roll_out(motion: Motion, sample: Vector, horizon: Horizon, poses: Array2[np.float64]) -> int:
    """Writes the poses (x, y, yaw) of one sample into ``poses``; returns their number."""
    return follow(motion, motion.velocity, sample, horizon.time, _steps(sample, horizon), poses)


@njit
def _finish(motion, sample, time, steps, looks, scored):
    """Writes the scored pose: the one after ``looks`` of the sample's ``steps``."""
    x, y, yaw = motion.pose[0], motion.pose[1], motion.pose[2]
    vx, vy, turn = motion.velocity[0], motion.velocity[1], motion.velocity[2]
    dt = time / steps
    while looks > 0 and not (vx == sample[0] and vy == sample[1] and turn == sample[2]):
        x, y, yaw, vx, vy, turn = moved(x, y, yaw, vx, vy, turn, sample, motion.acc, dt)
        looks -= 1
    # The rest is a polygon of equal steps and turns: take its chord, in the direction of its middle.
    half = 0.5 * turn * dt
    chord = dt * (np.sin(looks * half) / np.sin(half) if abs(half) > _STRAIGHT else looks)
    cosine = np.cos(yaw + (looks - 1) * half)
    sine = np.sin(yaw + (looks - 1) * half)
    scored[0] = x + (vx * cosine - vy * sine) * chord
    scored[1] = y + (vx * sine + vy * cosine) * chord
    scored[2] = yaw + looks * turn * dt


@njit
def _heading_difference(ground, plan, row, col, scored):
    """Returns the angle [rad] between a pose's heading and the farthest visible point of the plan; pi if none is.

    A point is visible if no cell on the line to it is inscribed, lethal or unknown.
    """
    rows, cols = ground.costs.shape
    place = ground.place
    for i in range(plan.shape[0] - 1, -1, -1):
        plan_row, plan_col = cell_at(place, plan[i, 0], plan[i, 1])
        if plan_row < 0 or plan_row >= rows or plan_col < 0 or plan_col >= cols:
            continue
        cost = line_cost(ground.costs, row, col, plan_row, plan_col)
        if cost < 0 or cost >= INSCRIBED:
            continue
        y = place.y + (plan_row + 0.5) * place.resolution - scored[1]
        x = place.x + (plan_col + 0.5) * place.resolution - scored[0]
        turn = np.arctan2(y, x) - scored[2]
        return abs(np.arctan2(np.sin(turn), np.cos(turn)))
    return np.pi


@njit
def cheapest(ground, motion, starts, samples, time, steps, scales, reach, every, limit, results):
    """Checks the samples marked UNCHECKED in the order of their bounds; returns the index of the cheapest, or -1.

    ``starts`` (n, 3) are their initial velocities, ``steps`` (n,) the numbers of poses checked within ``time`` [s].
    """
    best = -1
    while True:
        candidate = -1
        for i in range(samples.shape[0]):
            if results[i, COST] == UNCHECKED and (
                candidate < 0 or results[i, BOUND] < results[candidate, BOUND]
            ):
                candidate = i
        if candidate < 0:
            return best
        bound = results[candidate, BOUND]
        if bound > limit:
            return best
        cost = _check(
            ground,
            motion,
            starts[candidate],
            samples[candidate],
            time,
            steps[candidate],
            scales,
            reach,
            bound,
            limit,
        )
        results[candidate, COST] = cost
        if cost < 0.0:
            continue
        if (
            best < 0
            or cost < results[best, COST]
            or (cost == results[best, COST] and candidate < best)
        ):
            best = candidate
            if not every:
                limit = cost


@kernel
def search(
    ground: Ground,
    motion: Motion,
    samples: Array2[np.float64],
    horizon: Horizon,
    scales: Scales,
    plan: Points,
    reach: bool,
    every: bool,
    limit: float,
    results: Array2[np.float64],
) -> int:
    """Scores velocity samples; returns the index of the cheapest valid one, -1 if none is valid.

    Args:
        ground: costmap and the steps written by ``plan_distance.distance_grids``.
        motion: the robot's motion at the start.
        samples: velocities (n, 3) to try.
        horizon: simulation horizon.
        scales: weights of the costs.
        plan: the part of the plan ahead, for heading scoring; empty to disable it.
        reach: reject samples that cross cells not connected to plan and goal.
        every: check every sample, even those that cannot be the cheapest.
        limit: samples that cost more are invalid.
        results: per sample: cost (negative: why invalid), x, y, yaw of the scored end, and the bound.
    """
    rows, cols = ground.costs.shape
    count = samples.shape[0]
    heading = plan.shape[0] > 0
    starts = np.empty((count, 3))
    steps = np.empty(count, np.int64)
    for i in range(count):
        result = results[i]
        starts[i, :] = motion.velocity
        steps[i] = _steps(samples[i], horizon)
        looks = steps[i] - 1
        if heading:
            looks = min(looks, int(np.ceil(horizon.heading * steps[i] / horizon.time)))
        scored = result[X : YAW + 1]
        _finish(motion, samples[i], horizon.time, steps[i], looks, scored)
        result[COST] = UNCHECKED
        row, col = cell_at(ground.place, result[X], result[Y])
        if row < 0 or row >= rows or col < 0 or col >= cols:
            result[COST] = HIT
        elif reach and not is_reached(ground, row, col):
            result[COST] = UNREACHED
        else:
            result[BOUND] = (
                scales.plan * ground.to_plan[row, col] + scales.goal * ground.to_goal[row, col]
            )
            if heading:
                result[BOUND] += scales.heading * _heading_difference(
                    ground, plan, row, col, scored
                )
    strict = reach and not heading
    return cheapest(
        ground, motion, starts, samples, horizon.time, steps, scales, strict, every, limit, results
    )
