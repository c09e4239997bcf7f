"""An adaptive particle filter over poses (KLD sampling, Fox 2003), with recovery by random particles."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose
from nav_bundle.localisation import particle_kernel as kernel
from nav_bundle.localisation.config import AmclConfig
from nav_bundle.maps.grid import FREE, Grid

PoseSource = Callable[[int], NDArray[np.float64]]
"""Generates the given number of poses (x, y [m], yaw [rad]; shape (n, 3))."""
Judge = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Returns the likelihoods, shape (n,), of poses, shape (n, 3)."""
LARGEST_SHARE = 0.1
"""Largest share of random particles in a resampling. Particles at the true pose multiply by their likelihood over the
average, and by the share that is not random; without the limit, a share equal to the drop of the average would cancel
their growth."""
AT_ONCE = 10_000
"""Number of poses drawn and evaluated per call: more calls take time, more poses take memory."""
LEARNT = 0.05
"""Share of the particles that move to a pose at which the scan fits."""
LEARNT_SPREAD = (0.03, 0.03, 0.01)
"""Standard deviations of x, y [m], yaw [rad] about that pose."""
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
"""Inverse golden ratio: any number of its multiples modulo 1 is evenly distributed."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimate of the robot's pose."""

    pose: Pose  #: mean of the heaviest cluster of particles
    weight: float  #: that cluster's share of the total weight, 0 … 1
    #: covariance of all particles over x [m], y [m], yaw [rad], shape (3, 3); yaw is uncorrelated with x and y
    covariance: NDArray[np.float64]
    cluster_covariance: NDArray[np.float64]  #: covariance of the heaviest cluster alone


class FreeSpace:
    """Draws poses uniformly from the free cells of a map; stores one count per row, not an entry per free cell."""

    def __init__(self, grid: Grid, generator: np.random.Generator) -> None:
        self.grid = grid  #: the map
        self._generator = generator
        self._cells = np.ascontiguousarray(grid.cells)
        self._until_row = np.cumsum(np.count_nonzero(grid.cells == FREE, axis=1), dtype=np.int64)
        self.area = float(self._until_row[-1]) * grid.resolution**2  #: area of the free cells [m²]

    def draw(self, count: int) -> NDArray[np.float64]:
        """Returns ``count`` uniform poses in free cells, or in the whole map if no cell is free."""
        generator, free = self._generator, int(self._until_row[-1])
        cells = np.empty((count, 2), np.int64)
        if free:
            kernel.find_cells(
                self._cells, FREE, self._until_row, generator.integers(0, free, count), cells
            )
        else:
            cells[:] = generator.integers(0, self._cells.shape, (count, 2))
        points = self.grid.points_at(cells + generator.uniform(-0.5, 0.5, (count, 2)))
        return np.column_stack([points, generator.uniform(-math.pi, math.pi, count)])

    def draw_likely(self, count: int, rivals: int, likelihoods: Judge) -> NDArray[np.float64]:
        """Returns ``count`` poses, each the likeliest of ``rivals`` drawn from the free space."""
        best, heights = np.empty((count, 3)), np.full(count, -np.inf)
        at_once = max(1, AT_ONCE // max(1, count))
        for begin in range(0, rivals, at_once):
            rounds = min(at_once, rivals - begin)
            poses = self.draw(rounds * count)
            values = likelihoods(poses).reshape(rounds, count)
            first, every = values.argmax(axis=0), np.arange(count)
            better = values[first, every] > heights
            best[better] = poses.reshape(rounds, count, 3)[first, every][better]
            heights[better] = values[first, every][better]
        return best


class ParticleFilter:
    """Weighted poses in the map frame."""

    def __init__(self, config: AmclConfig, generator: np.random.Generator) -> None:
        self._config, self._generator = config, generator
        #: x, y [m], yaw [rad], shape (n, 3), float64; n changes with each resampling
        self.poses: NDArray[np.float64] = np.zeros((config.max_particles, 3))
        self.weights = _equal_weights(config.max_particles)  #: shape (n,), sum 1
        self._table, self._labels = _scratch(config.max_particles)
        self._slow = self._fast = 0.0

    def configure(self, config: AmclConfig) -> None:
        """Applies new parameters; keeps the particles."""
        self._config = config
        self._table, self._labels = _scratch(max(config.max_particles, len(self.poses)))

    def replace(self, poses: NDArray[np.float64]) -> None:
        """Restarts from ``poses``, shape (n, 3), with equal weights."""
        self.poses = np.ascontiguousarray(poses, np.float64)
        self.weights = _equal_weights(len(poses))
        self._slow = self._fast = 0.0

    def gather(self, pose: Pose, covariance: NDArray[np.float64]) -> None:
        """Restarts from a normal distribution about ``pose``; ``covariance`` over x, y, yaw, shape (3, 3)."""
        values, axes = np.linalg.eigh(covariance)
        spread = axes * np.sqrt(np.maximum(values, 0.0))
        normal = self._generator.standard_normal((self._config.max_particles, 3))
        self.replace(normal @ spread.T + np.array([pose.x, pose.y, pose.yaw]))

    def weigh(self, likelihoods: NDArray[np.float64]) -> None:
        """Multiplies the weights by ``likelihoods``, shape (n,), and updates their slow and fast averages."""
        weights = self.weights * likelihoods
        total = float(weights.sum())
        if not (total > 0.0 and math.isfinite(total)):
            self.weights = _equal_weights(len(weights))
            return
        self.weights = weights / total
        self._slow = self._followed(self._slow, total, self._config.recovery_alpha_slow)
        self._fast = self._followed(self._fast, total, self._config.recovery_alpha_fast)

    @staticmethod
    def _followed(mean: float, value: float, rate: float) -> float:
        return value if mean == 0.0 else mean + rate * (value - mean)

    def resample(self, random_poses: PoseSource, recovers: bool = True) -> None:
        """Resamples the particles by their weights; the number adapts to their spread (KLD sampling).

        Draws are evenly spaced over the weights (low variance), since independent draws can lose the few particles
        at the true pose by chance. If scans have recently become less likely than in the long run, a share of at most
        ``LARGEST_SHARE`` is drawn from ``random_poses`` until the likelihood has recovered (augmented MCL; Noetic's
        amcl resets both averages after the first such draw); none if not ``recovers``.
        """
        config, generator = self._config, self._generator
        if config.selective_resampling and 1.0 / float((self.weights**2).sum()) > 0.5 * len(
            self.weights
        ):
            return
        most = config.max_particles
        fall = 1.0 - self._fast / self._slow if self._slow > 0.0 else 0.0
        share = min(max(0.0, fall), LARGEST_SHARE) if recovers else 0.0
        uniforms = (generator.random() + GOLDEN * np.arange(most)) % 1.0
        renew, fresh = np.zeros(most, np.uint8), np.zeros((most, 3))
        if share > 0.0:
            renew = (generator.random(most) < share).astype(np.uint8)
            fresh[renew > 0] = random_poses(int(renew.sum()))
        drawn = np.empty((most, 3))
        draws = kernel.Draws(np.cumsum(self.weights), uniforms, renew, fresh)
        limits = kernel.Limits(config.min_particles, config.kld_err, config.kld_z)
        count = kernel.resample(self.poses, draws, limits, self._table, drawn)
        self.poses = drawn[:count].copy()
        self.weights = _equal_weights(count)

    def learn(self, pose: Pose) -> None:
        """Moves a few particles to ``pose``, since the cloud lags behind with poor odometry; later scans weight them.

        Does nothing if recovery by random particles is on: recovery must find a robot that was carried away, and a
        wrong pose that fits partly must not attract particles.
        """
        if self._config.recovery_alpha_fast > 0.0:
            return
        count = int(LEARNT * len(self.poses))
        drawn = self._generator.normal((pose.x, pose.y, pose.yaw), LEARNT_SPREAD, (count, 3))
        self.poses[self._generator.integers(0, len(self.poses), count)] = drawn

    def estimate(self) -> Estimate:
        """Returns the mean of the heaviest cluster and the covariance of all particles."""
        sums = np.empty((len(self.poses), 9))
        clusters = kernel.cluster(self.poses, self.weights, self._table, self._labels, sums)
        best = sums[:clusters][sums[:clusters, 1].argmax()]
        _, weight, x, y, cosine, sine = best[:6].tolist()
        pose = Pose(x / weight, y / weight, math.atan2(sine, cosine))
        return Estimate(pose, weight, _covariance(sums[:clusters].sum(axis=0)), _covariance(best))


def _equal_weights(count: int) -> NDArray[np.float64]:
    return np.full(count, 1.0 / count)


def _scratch(most: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns the kernels' hash table and its labels, for at most ``most`` particles."""
    table = np.empty(1 << (2 * most).bit_length(), np.int64)
    return table, np.empty_like(table)


def _covariance(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the covariance of x, y, yaw from the sums of ``kernel.cluster``; yaw as a wrapped normal distribution."""
    x, y, cosine, sine, xx, xy, yy = (sums[2:] / sums[1]).tolist()
    length = min(1.0, max(1e-12, math.hypot(cosine, sine)))
    result = np.zeros((3, 3))
    result[0, 0], result[1, 1] = max(0.0, xx - x * x), max(0.0, yy - y * y)
    result[0, 1] = result[1, 0] = xy - x * y
    result[2, 2] = -2.0 * math.log(length)
    return result
