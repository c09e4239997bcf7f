"""Scan-to-map alignment that corrects the last centimetres of a particle filter's estimate."""

import math

import numpy as np

from nav_bundle.localisation.likelihood_kernel import Field
from pioneer_kernels.declaration import Array1, Array2, kernel, njit

LONGEST_STEP = 0.1
"""Largest step of one iteration [m], [rad], beyond which the linearised distance is unreliable."""
SETTLED = 1e-4
"""Convergence threshold: the iteration ends after a step smaller than this [m], [rad]."""


@njit
def _distance(x, y, field, out):
    """Writes distance to the nearest obstacle [cells] and its gradient at (x, y) [cells]; False outside the grid."""
    left, low = math.floor(x - 0.5), math.floor(y - 0.5)
    col, row = np.int64(left), np.int64(low)
    if row < 0 or col < 0 or row + 1 >= field.shape[0] or col + 1 >= field.shape[1]:
        return False
    u, v = x - 0.5 - left, y - 0.5 - low
    d00, d01 = math.sqrt(field[row, col]), math.sqrt(field[row, col + 1])
    d10, d11 = math.sqrt(field[row + 1, col]), math.sqrt(field[row + 1, col + 1])
    out[0] = (1 - v) * ((1 - u) * d00 + u * d01) + v * ((1 - u) * d10 + u * d11)
    out[1] = (1 - v) * (d01 - d00) + v * (d11 - d10)
    out[2] = (1 - u) * (d10 - d00) + u * (d11 - d01)
    return True


@njit
def _solve(matrix, vector, out):
    """Solves a symmetric positive definite 3 x 3 system by Cholesky decomposition."""
    lower = np.zeros((3, 3))
    for i in range(3):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(max(total, 1e-12)) if i == j else total / lower[j, j]
    for i in range(3):
        total = vector[i]
        for k in range(i):
            total -= lower[i, k] * out[k]
        out[i] = total / lower[i, i]
    for i in range(2, -1, -1):
        total = out[i]
        for k in range(i + 1, 3):
            total -= lower[k, i] * out[k]
        out[i] = total / lower[i, i]


@njit
def _gather(pose, points, field, sigma, matrix, vector):
    """Adds the beams' normal equations at ``pose``; returns the sum of the beams' weights."""
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    placement = field.placement
    scale = placement[4]
    sample = np.empty(3)
    row = np.empty(3)
    total = 0.0
    for beam in range(points.shape[0]):
        along = cosine * points[beam, 0] - sine * points[beam, 1]
        across = sine * points[beam, 0] + cosine * points[beam, 1]
        dx, dy = pose[0] + along - placement[0], pose[1] + across - placement[1]
        x, y = (
            (placement[2] * dx + placement[3] * dy) * scale,
            (placement[2] * dy - placement[3] * dx) * scale,
        )
        if not _distance(x, y, field.squares, sample):
            continue
        distance = sample[0] / scale
        weight = math.exp(-distance * distance / (2.0 * sigma * sigma))
        total += weight
        row[0] = placement[2] * sample[1] - placement[3] * sample[2]
        row[1] = placement[3] * sample[1] + placement[2] * sample[2]
        row[2] = row[1] * along - row[0] * across
        for i in range(3):
            vector[i] -= weight * row[i] * distance
            for j in range(3):
                matrix[i, j] += weight * row[i] * row[j]
    return total


@kernel
def align(
    start: Array1[np.float64],
    points: Array2[np.float64],
    field: Field,
    information: Array2[np.float64],
    sigma: float,
    iterations: int,
    out: Array1[np.float64],
) -> float:
    """Writes the pose near ``start`` at which a scan's end points fit the obstacles best; returns their agreement.

    Gauss-Newton on the distances to the nearest obstacle, with each beam weighted by exp(-d² / 2 sigma²) (Welsch's
    robust weight). A normal prior about ``start`` constrains directions that the scan does not determine.

    Args:
        start: x, y [m], yaw [rad], map frame.
        points: end points [m], robot frame, shape (m, 2).
        field: distances to obstacles.
        information: inverse covariance of the prior times the variance of one beam, shape (3, 3).
        sigma: standard deviation [m] of hits about obstacles.
        iterations: maximum number of iterations.
        out: the resulting pose, shape (3,).

    Returns:
        The share of beams that hit obstacles at the resulting pose (sum of the weights over their number), 0 … 1.
    """
    out[:] = start
    matrix = np.empty((3, 3))
    vector = np.empty(3)
    step = np.empty(3)
    for _ in range(iterations):
        matrix[:] = information
        for i in range(3):
            vector[i] = 0.0
            for j in range(3):
                vector[i] -= information[i, j] * (out[j] - start[j])
        _gather(out, points, field, sigma, matrix, vector)
        _solve(matrix, vector, step)
        length = max(abs(step[0]), abs(step[1]), abs(step[2]))
        shrink = LONGEST_STEP / length if length > LONGEST_STEP else 1.0
        for i in range(3):
            out[i] += shrink * step[i]
        if length < SETTLED:
            break
    return _gather(out, points, field, sigma, matrix, vector) / max(1, points.shape[0])
