"""Laser sensor models for particles (Thrun, Burgard and Fox, Probabilistic Robotics, chapter 6)."""

import math

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.scan import Beams
from nav_bundle.localisation import likelihood_kernel as kernel
from nav_bundle.localisation.config import AmclConfig
from nav_bundle.maps.grid import OCCUPIED, Grid

LONGEST_FIELD = 255
"""Maximum reach of a likelihood field [cells], so that squared distances fit into 16 bits."""

GATHERED = 0.5
"""Beams are skipped only if every particle is within this distance [m] of the mean, along x and along y."""


def placement(grid: Grid) -> NDArray[np.float64]:
    """Returns the origin and resolution of ``grid`` in the kernels' format."""
    yaw = grid.origin.yaw
    return np.array(
        [grid.origin.x, grid.origin.y, math.cos(yaw), math.sin(yaw), 1.0 / grid.resolution]
    )


class DistanceField:
    """Distance of each map cell to the nearest obstacle, two bytes per cell."""

    def __init__(self, grid: Grid, reach: float) -> None:
        self.resolution = grid.resolution  #: cell size [m]
        self.cap = max(
            1, min(LONGEST_FIELD, math.ceil(reach / grid.resolution))
        )  #: maximum distance [cells]
        #: squared distances [cells²] between cell centres, shape (rows, cols), at most the square of ``cap``
        self.cells = kernel.Field(np.empty(grid.cells.shape, np.uint16), placement(grid))
        kernel.distance_field(
            np.ascontiguousarray(grid.cells), OCCUPIED, self.cap, self.cells.squares
        )

    def are_occupied(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns whether points [m, map frame] are in occupied cells; those outside the map are not."""
        squares, (origin_x, origin_y, cosine, sine, scale) = (
            self.cells.squares,
            self.cells.placement,
        )
        along = (cosine * (x - origin_x) + sine * (y - origin_y)) * scale
        across = (cosine * (y - origin_y) - sine * (x - origin_x)) * scale
        rows, cols = squares.shape
        inside = (along >= 0.0) & (along < cols) & (across >= 0.0) & (across < rows)
        found = np.zeros(x.shape, bool)
        at = across[inside].astype(np.int64), along[inside].astype(np.int64)
        found[inside] = squares[at] == 0
        return found


class LikelihoodField:
    """Likelihood field model: a beam's likelihood depends on the distance of its end point to the nearest obstacle.

    A table maps squared distances to likelihoods, so that weighting a particle needs no exponential.
    """

    capacity = 600_000  #: approximate number of poses evaluated in half a second

    def __init__(self, config: AmclConfig, grid: Grid) -> None:
        self._config = config
        self.field = DistanceField(
            grid, config.laser_likelihood_max_dist
        )  #: distances to the nearest obstacle
        distances = np.sqrt(np.arange(self.field.cap**2 + 1)) * grid.resolution
        distances = np.minimum(distances, config.laser_likelihood_max_dist)
        self._hit = config.laser_z_hit * np.exp(-(distances**2) / (2.0 * config.laser_sigma_hit**2))

    def _beam_likelihoods(self, beams: Beams) -> NDArray[np.float64]:
        return self._hit + self._config.laser_z_rand / beams.range_max

    def likelihoods(self, particles: NDArray[np.float64], beams: Beams) -> NDArray[np.float64]:
        """Returns 1 + the sum of the beams' cubed likelihoods, as amcl does; this is less peaked than the product."""
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
    """Likelihood field model that multiplies the beams' likelihoods ("likelihood_field_prob"), with beam skipping."""

    def likelihoods(self, particles: NDArray[np.float64], beams: Beams) -> NDArray[np.float64]:
        """Returns the product of the beams' likelihoods."""
        points = beams.end_points()
        if self._config.do_beamskip and _gathered(particles):
            points = self._agreed(particles, points)
        result = np.zeros(len(particles))
        self._add(particles, points, np.log(self._beam_likelihoods(beams)), result)
        return np.exp(result)

    def _agreed(
        self, particles: NDArray[np.float64], points: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Drops beams that few particles can explain (such as people nearby), unless that would drop nearly all."""
        config = self._config
        kept = (
            self._agreement(particles, points, config.beam_skip_distance)
            > config.beam_skip_threshold
        )
        if np.count_nonzero(~kept) >= len(points) * config.beam_skip_error_threshold:
            return points
        return points[kept]


def _gathered(particles: NDArray[np.float64]) -> bool:
    """Returns whether the particles are so close together that a beam that few explain hit an unmapped obstacle."""
    places = particles[:, :2]
    return bool((np.abs(places - places.mean(axis=0)) < GATHERED).all())


class BeamModel:
    """Beam model: compares each range with the map's prediction (hit, unexpected object, no return, noise)."""

    capacity = 20_000

    def __init__(self, config: AmclConfig, grid: Grid) -> None:
        self._config = config
        self._cells = np.ascontiguousarray(grid.cells)
        self._placement = placement(grid)

    def likelihoods(self, particles: NDArray[np.float64], beams: Beams) -> NDArray[np.float64]:
        """Returns 1 + the sum of the beams' cubed likelihoods, as amcl does."""
        config = self._config
        expected = np.empty((len(particles), len(beams.ranges)))
        laser = np.array([beams.laser.x, beams.laser.y, beams.laser.yaw])
        kernel.expected_ranges(
            particles,
            laser,
            beams.bearings,
            self._cells,
            self._placement,
            beams.range_max,
            expected,
        )
        excess = beams.ranges - expected
        nothing = beams.ranges >= beams.range_max
        result = config.laser_z_hit * np.exp(-(excess**2) / (2.0 * config.laser_sigma_hit**2))
        short = (
            config.laser_z_short
            * config.laser_lambda_short
            * np.exp(-config.laser_lambda_short * beams.ranges)
        )
        result += np.where(excess < 0.0, short, 0.0)
        result += np.where(nothing, config.laser_z_max, config.laser_z_rand / beams.range_max)
        return 1.0 + (result**3).sum(axis=1)


SensorModel = LikelihoodField | BeamModel
"""Computes the likelihoods, shape (n,), of particles (x, y [m], yaw [rad], map frame; shape (n, 3)) given a scan."""


def sensor_model(config: AmclConfig, grid: Grid) -> SensorModel:
    """Returns the sensor model selected by ``laser_model_type``, for ``grid``."""
    if config.laser_model_type == "beam":
        return BeamModel(config, grid)
    if config.laser_model_type == "likelihood_field_prob":
        return LikelihoodFieldProduct(config, grid)
    return LikelihoodField(config, grid)
