"""How well particles explain a laser scan (Thrun, Burgard and Fox, Probabilistic Robotics, chapter 6)."""

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core.amcl_config import AmclConfig
from nav_bundle.core.grid import OCCUPIED, Grid
from nav_bundle.core.pose import Pose
from nav_bundle.kernels import likelihood as kernel

LONGEST_FIELD = 255
"""Cells a likelihood field reaches at most: squared distances fit 16 bits."""

GATHERED = 0.5
"""Beams are skipped only when every particle is this close [m] to their mean, along x and along y."""


@dataclass(frozen=True, eq=False)
class Scan:
    """One planar laser scan."""

    #: measured distances [m], shape (n,); NaN and anything at or beyond ``range_max`` is "nothing seen"
    ranges: NDArray[np.float32] = field(repr=False)
    angle_min: float  #: direction of the first beam [rad] in the laser's frame
    angle_increment: float  #: angle between beams [rad]; negative for a laser mounted upside down
    range_min: float  #: shorter ranges count as nothing seen [m]
    range_max: float  #: [m]
    laser: Pose  #: pose of the laser in the robot's frame

    def thinned(self, beams: int, shortest: float, longest: float) -> "Beams":
        """Returns about ``beams`` beams spread over the scan, with range limits that bind where they are positive."""
        step = max(1, (len(self.ranges) - 1) // (beams - 1))
        range_max = min(self.range_max, longest) if longest > 0.0 else self.range_max
        range_min = max(self.range_min, shortest) if shortest > 0.0 else self.range_min
        ranges = self.ranges[::step].astype(np.float64)
        bearings = self.angle_min + self.angle_increment * step * np.arange(len(ranges))
        valid = ~np.isnan(ranges)
        ranges, bearings = ranges[valid], bearings[valid]
        ranges[(ranges <= range_min) | (ranges > range_max)] = range_max
        return Beams(ranges, bearings, range_max, self.laser)


@dataclass(frozen=True, eq=False)
class Beams:
    """The beams of a scan that are used: ``ranges`` [m] and ``bearings`` [rad, laser frame], both shape (m,)."""

    ranges: NDArray[np.float64]
    bearings: NDArray[np.float64]
    range_max: float
    laser: Pose

    def end_points(self) -> NDArray[np.float64]:
        """Returns where the beams ended that ended somewhere (x, y) [m, robot frame], shape (k, 2)."""
        seen = self.ranges < self.range_max
        ranges, angles = self.ranges[seen], self.bearings[seen] + self.laser.yaw
        laser = np.array([self.laser.x, self.laser.y])
        return laser + np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)


class SensorModel(Protocol):
    """Judges particles by a scan."""

    capacity: int  #: poses that it judges in half a second, more or less

    def likelihoods(self, particles: NDArray[np.float64], beams: Beams) -> NDArray[np.float64]:
        """Returns how well particles (x, y [m], yaw [rad], map frame; shape (n, 3)) explain the beams: shape (n,)."""


def placement(grid: Grid) -> NDArray[np.float64]:
    """Returns where ``grid`` lies, as the kernels take it."""
    yaw = grid.origin.yaw
    return np.array([grid.origin.x, grid.origin.y, math.cos(yaw), math.sin(yaw), 1.0 / grid.resolution])


class DistanceField:
    """How far each place of a map is from the nearest obstacle, in two bytes a cell."""

    def __init__(self, grid: Grid, reach: float) -> None:
        self.resolution = grid.resolution  #: side of a cell [m]
        self.cap = max(1, min(LONGEST_FIELD, math.ceil(reach / grid.resolution)))  #: where the field ends [cells]
        #: squared distances [cells²] between centres of cells, shape (rows, cols), at most the square of ``cap``
        self.cells = kernel.Field(np.empty(grid.cells.shape, np.uint16), placement(grid))
        kernel.distance_field(np.ascontiguousarray(grid.cells), OCCUPIED, self.cap, self.cells.squares)


class LikelihoodField:
    """Obstacles blurred: how likely a beam ends at a place, by its distance to the nearest obstacle of the map.

    A table turns squared distances into likelihoods, so that weighing a particle needs no exponential.
    """

    capacity = 600_000

    def __init__(self, config: AmclConfig, grid: Grid) -> None:
        self._config = config
        self.field = DistanceField(grid, config.laser_likelihood_max_dist)  #: the distances
        distances = np.sqrt(np.arange(self.field.cap**2 + 1)) * grid.resolution
        distances = np.minimum(distances, config.laser_likelihood_max_dist)
        self._hit = config.laser_z_hit * np.exp(-(distances**2) / (2.0 * config.laser_sigma_hit**2))

    def _beam_likelihoods(self, beams: Beams) -> NDArray[np.float64]:
        return self._hit + self._config.laser_z_rand / beams.range_max

    def likelihoods(self, particles: NDArray[np.float64], beams: Beams) -> NDArray[np.float64]:
        """Returns 1 + the sum of the cubed likelihoods of the beams: upstream's, blunter than their product."""
        result = np.ones(len(particles))
        self._add(particles, beams.end_points(), self._beam_likelihoods(beams) ** 3, result)
        return result

    def _add(
        self,
        particles: NDArray[np.float64],
        points: NDArray[np.float64],
        table: NDArray[np.float64],
        out: NDArray[np.float64],
    ) -> None:
        cells = np.ascontiguousarray(points / self.field.resolution)
        kernel.add_likelihoods(particles, cells, self.field.cells, table, out)

    def _agreement(
        self, particles: NDArray[np.float64], points: NDArray[np.float64], distance: float
    ) -> NDArray[np.float64]:
        """Returns the share of particles that see an obstacle within ``distance`` [m] of each point."""
        counts = np.zeros(len(points), np.int64)
        cells = np.ascontiguousarray(points / self.field.resolution)
        nearest = math.ceil((distance / self.field.resolution) ** 2)
        kernel.count_agreement(particles, cells, self.field.cells, nearest, counts)
        return counts / len(particles)


class LikelihoodFieldProduct(LikelihoodField):
    """The likelihood field with the beams' likelihoods multiplied ("likelihood_field_prob"), and beam skipping."""

    def likelihoods(self, particles: NDArray[np.float64], beams: Beams) -> NDArray[np.float64]:
        """Returns the product of the beams' likelihoods."""
        points = beams.end_points()
        if self._config.do_beamskip and _gathered(particles):
            points = self._agreed(particles, points)
        result = np.zeros(len(particles))
        self._add(particles, points, np.log(self._beam_likelihoods(beams)), result)
        return np.exp(result)

    def _agreed(self, particles: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Drops beams that few particles can explain (people in the way), unless that were nearly all of them."""
        config = self._config
        kept = self._agreement(particles, points, config.beam_skip_distance) > config.beam_skip_threshold
        if np.count_nonzero(~kept) >= len(points) * config.beam_skip_error_threshold:
            return points
        return points[kept]


def _gathered(particles: NDArray[np.float64]) -> bool:
    """Tells whether all particles lie so close together [m] that a beam few can explain met something unmapped."""
    places = particles[:, :2]
    return bool((np.abs(places - places.mean(axis=0)) < GATHERED).all())


class BeamModel:
    """Compares each range with the one that the map predicts: hits, things in the way, nothing seen, and noise."""

    capacity = 20_000

    def __init__(self, config: AmclConfig, grid: Grid) -> None:
        self._config = config
        self._cells = np.ascontiguousarray(grid.cells)
        self._placement = placement(grid)

    def likelihoods(self, particles: NDArray[np.float64], beams: Beams) -> NDArray[np.float64]:
        """Returns 1 + the sum of the cubed likelihoods of the beams, as upstream."""
        config = self._config
        expected = np.empty((len(particles), len(beams.ranges)))
        laser = np.array([beams.laser.x, beams.laser.y, beams.laser.yaw])
        kernel.expected_ranges(
            particles, laser, beams.bearings, self._cells, self._placement, beams.range_max, expected
        )
        excess = beams.ranges - expected
        nothing = beams.ranges >= beams.range_max
        result = config.laser_z_hit * np.exp(-(excess**2) / (2.0 * config.laser_sigma_hit**2))
        short = config.laser_z_short * config.laser_lambda_short * np.exp(-config.laser_lambda_short * beams.ranges)
        result += np.where(excess < 0.0, short, 0.0)
        result += np.where(nothing, config.laser_z_max, config.laser_z_rand / beams.range_max)
        return 1.0 + (result**3).sum(axis=1)


def sensor_model(config: AmclConfig, grid: Grid) -> SensorModel:
    """Returns the model that ``laser_model_type`` names, for ``grid``."""
    if config.laser_model_type == "beam":
        return BeamModel(config, grid)
    if config.laser_model_type == "likelihood_field_prob":
        return LikelihoodFieldProduct(config, grid)
    return LikelihoodField(config, grid)
