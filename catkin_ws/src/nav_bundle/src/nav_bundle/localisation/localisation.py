"""Adaptive Monte Carlo localisation: estimates the robot's pose in the map from odometry and scans. Without ROS."""

import math
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.error import NavigationError
from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.base.scan import Beams, Scan
from nav_bundle.localisation.alignment_kernel import align
from nav_bundle.localisation.config import AmclConfig
from nav_bundle.localisation.motion_model import MotionModel, motion_model
from nav_bundle.localisation.particle_filter import Estimate, FreeSpace, Judge, ParticleFilter
from nav_bundle.localisation.sensor_model import (
    DistanceField,
    LikelihoodField,
    SensorModel,
    sensor_model,
)
from nav_bundle.maps.grid import Grid

RIVALS = 50
"""Number of candidate poses from which the likeliest becomes a random particle."""
DENSITY = 1000.0
"""Candidate poses per area [1/m²] for the first scan of global localisation, if the sensor model can evaluate as many:
seven for each 0.5 m by 0.5 m by 10°."""
DOUBTS = 4
"""After this many consecutive estimates that the scan contradicts, the robot counts as lost."""
DOUBTFUL = 0.75
"""Scans of which a smaller share fits the map are examined for contradictions."""
CONTRADICTION = 0.1
"""A scan contradicts an estimate if more of its beams than this share lead through obstacles of the map, ..."""
OUTWEIGHING = 0.5
"""... and more than this share of those that fit: a door that has been opened is no reason for doubt."""
EXAMINED_BEAMS = 60
PASSAGE = 0.3
"""A beam must lead this far beyond an obstacle, and begin as far before it, to have passed it [m]."""
REFINING_BEAMS = 180
"""Beams used to refine an estimate; many are affordable here, since only one pose is evaluated, not hundreds."""
SIGMA = 0.1
"""Standard deviation of hits about obstacles [m]; a hit farther than three times this counts as unmapped."""
PRIOR_FLOOR = 0.1
"""Standard deviation [m], [rad] added to the particles' spread, because all particles can share an error this large."""
ITERATIONS = 10
LEAST_AGREEMENT = 0.4
"""Share of the beams that must hit mapped obstacles for the fit to be accepted."""
FARTHEST = 0.5
"""A fit that moves the estimate farther than this [m], [rad] is rejected: it found another place."""


class NoMapError(NavigationError):
    """An operation needs a map, but none has been set yet."""


@dataclass(frozen=True, eq=False)
class Update:
    """Result of one scan."""

    #: the robot's pose when the scan was taken; None if the particles were weighted but not resampled
    estimate: Estimate | None
    map_from_odom: (
        Pose | None
    )  #: the odometry frame's pose in the map; None if ``estimate`` is None


class Localisation:
    """Tracks a robot in a map with a particle filter.

    Args:
        config: amcl's parameters.
        generator: source of all randomness; the same seed gives the same results.
    """

    def __init__(self, config: AmclConfig, generator: np.random.Generator) -> None:
        self._config = config
        self._filter = ParticleFilter(config, generator)
        self._generator = generator
        self._move = _motion_model(config)
        self._sensor: SensorModel | None = None
        self._free: FreeSpace | None = None
        self._odom: Pose | None = None
        self._forced = self._scattered = False
        self._used: set[str] = set()  # lasers whose scans were used since the robot last moved
        self._updates = self._doubts = 0
        self.agreement = (
            1.0  #: share of the last scan's beams that fit the map; 1 without ``refine_estimate``
        )

    @property
    def particles(self) -> NDArray[np.float64]:
        """The particles' x, y [m], yaw [rad] in the map, shape (n, 3)."""
        return self._filter.poses

    @property
    def has_map(self) -> bool:
        """Returns whether a map has been set."""
        return self._sensor is not None

    @property
    def lost(self) -> bool:
        """Returns whether the last ``DOUBTS`` scans contradicted the map at the estimated pose.

        Things that the map does not show make beams shorter, and are no contradiction, whatever part of the view they
        fill. Nothing makes beams longer: those that would have to pass through walls speak against the pose.
        """
        return self._doubts >= DOUBTS

    def set_map(self, grid: Grid) -> None:
        """Sets the map; keeps the particles."""
        # Frees the old likelihood field first, so that memory never holds two fields of a large map.
        self._sensor = self._free = None
        self._sensor = sensor_model(self._config, grid)
        self._free = FreeSpace(grid, self._generator)

    def configure(self, config: AmclConfig) -> None:
        """Applies new parameters; keeps the particles; the next resampling adapts their number."""
        before, self._config = self._config, config
        self._filter.configure(config)
        self._move = _motion_model(config)
        sensing = [
            field.name
            for field in fields(config)
            if field.name.startswith(("laser_", "do_beam", "beam_"))
        ]
        if self._free is not None and any(
            getattr(config, name) != getattr(before, name) for name in sensing
        ):
            self._sensor = None
            self._sensor = sensor_model(config, self._free.grid)

    def set_pose(self, pose: Pose, covariance: NDArray[np.float64]) -> None:
        """Restarts with particles around ``pose`` (map frame); ``covariance`` over x, y, yaw, shape (3, 3)."""
        self._filter.gather(pose, covariance)
        self._odom, self._scattered = None, False
        self._doubts = 0

    def scatter(self) -> None:
        """Restarts with particles spread over the free space (global localisation).

        Raises:
            NoMapError: there is no map yet.
        """
        if self._free is None:
            raise NoMapError("no map yet: cannot spread particles over its free space")
        self._filter.replace(self._free.draw(self._config.max_particles))
        self._odom, self._scattered = None, True

    def force_update(self) -> None:
        """Makes the next scan due even if the robot has not moved."""
        self._forced = True

    def due(self, odom: Pose, laser: str = "") -> bool:
        """Returns whether a scan at odometry pose ``odom`` is due: first scan, forced, or enough movement.

        Of each laser, named by ``laser``, one scan is due then.
        """
        if self._odom is None or self._forced:
            return True
        turn = angle_difference(odom.yaw, self._odom.yaw)
        step = max(abs(odom.x - self._odom.x), abs(odom.y - self._odom.y))
        if step > self._config.update_min_d or abs(turn) > self._config.update_min_a:
            self._used.clear()
        return laser not in self._used

    def advance(self, odom: Pose, scan: Scan, laser: str = "") -> Update:
        """Moves the particles to odometry pose ``odom`` (odom frame, at the scan's time), weights and resamples them.

        The first scan after a restart always gives an estimate; later only every ``resample_interval``-th scan does.

        Raises:
            NoMapError: there is no map yet.
        """
        if self._sensor is None or self._free is None:
            raise NoMapError("no map yet: cannot use scans")
        first = self._odom is None
        if self._odom is None:
            self._updates = 0
        else:
            self._move(self._filter.poses, self._odom, odom, self._generator)
        if first or self._forced:
            self._used.clear()
        self._used.add(laser)
        self._odom, self._forced = odom, False
        config = self._config
        beams = self._thinned(scan, config.laser_max_beams)
        likelihoods = partial(self._sensor.likelihoods, beams=beams)
        if (
            self._scattered
        ):  # a sparse uniform spread may miss the true pose: draw where the scan is likely instead
            count = config.max_particles
            rivals = max(RIVALS, math.ceil(DENSITY * self._free.area / count))
            self._filter.replace(
                _likely(self._free, likelihoods, rivals, self._sensor.capacity, count)
            )
            self._scattered = False
        self._filter.weigh(likelihoods(self._filter.poses))
        self._updates += 1
        resampled = self._updates % config.resample_interval == 0
        if resampled:
            self._filter.resample(
                partial(_likely, self._free, likelihoods, RIVALS, self._sensor.capacity // 10),
                recovers=self._doubts > 0
                or not (self._config.refine_estimate and isinstance(self._sensor, LikelihoodField)),
            )
        if not (resampled or first):
            return Update(None, None)
        estimate = self._refined(self._filter.estimate(), scan)
        return Update(estimate, estimate.pose.compose(odom.inverse()))

    def agreement_at(self, pose: Pose, scan: Scan) -> float:
        """Returns the share of a scan's beams that fit the map near a pose; 1 for a sensor model that cannot tell."""
        if not isinstance(self._sensor, LikelihoodField):
            return 1.0
        certain = np.zeros((3, 3))
        beams = self._thinned(scan, REFINING_BEAMS)
        _, agreement = _fitted(Estimate(pose, 1.0, certain, certain), beams, self._sensor.field)
        return agreement

    def _refined(self, estimate: Estimate, scan: Scan) -> Estimate:
        """Fits the scan to the map near the estimate, and moves a few particles to the fitted pose.

        Otherwise the cloud would lag further behind. Moving all would narrow it.
        """
        if not (self._config.refine_estimate and isinstance(self._sensor, LikelihoodField)):
            return estimate
        pose, self.agreement = _fitted(
            estimate, self._thinned(scan, REFINING_BEAMS), self._sensor.field
        )
        self._doubts = self._doubts + 1 if self._is_contradicted(pose, scan) else 0
        if pose is not estimate.pose:
            self._filter.learn(pose)
        return replace(estimate, pose=pose)

    def _is_contradicted(self, pose: Pose, scan: Scan) -> bool:
        """Returns whether a scan speaks against an estimated pose."""
        if self.agreement >= DOUBTFUL:
            return False
        assert isinstance(self._sensor, LikelihoodField)
        passing = _passing(pose, self._thinned(scan, EXAMINED_BEAMS), self._sensor.field)
        return passing > max(CONTRADICTION, OUTWEIGHING * self.agreement)

    def _thinned(self, scan: Scan, beams: int) -> Beams:
        return scan.thinned(beams, self._config.laser_min_range, self._config.laser_max_range)


def _fitted(estimate: Estimate, beams: Beams, field: DistanceField) -> tuple[Pose, float]:
    """Returns the pose near the estimate at which the beams fit the map best, and the share of beams that fit.

    amcl's likelihoods are broad, so its estimate lags behind the robot by about 5 to 10 cm, more with poor odometry. It
    is a good starting point for the least-squares fit, which stays within the filter's spread. Returns the estimate's
    own pose if too few beams fit or the fit moved too far.
    """
    points = np.ascontiguousarray(beams.end_points())
    if len(points) == 0:
        return estimate.pose, 0.0
    prior = estimate.cluster_covariance + np.eye(3) * PRIOR_FLOOR**2
    try:
        information = np.ascontiguousarray(np.linalg.inv(prior) * SIGMA**2)
    except (
        np.linalg.LinAlgError
    ):  # particles thousands of kilometres apart: the estimate means nothing
        return estimate.pose, 0.0
    start, found = np.array([estimate.pose.x, estimate.pose.y, estimate.pose.yaw]), np.empty(3)
    agreement = align(start, points, field.cells, information, SIGMA, ITERATIONS, found)
    pose = Pose(*found.tolist())
    near = pose.distance(estimate.pose) < FARTHEST
    near = near and abs(angle_difference(pose.yaw, estimate.pose.yaw)) < FARTHEST
    return pose if near and agreement >= LEAST_AGREEMENT else estimate.pose, agreement


def _passing(pose: Pose, beams: Beams, field: DistanceField) -> float:
    """Returns the share of the beams with a return that would have led through an obstacle of the map at a pose."""
    points = beams.end_points()
    if len(points) == 0:
        return 0.0
    laser = np.array([beams.laser.x, beams.laser.y])
    offsets = points - laser
    lengths = np.hypot(offsets[:, 0], offsets[:, 1])
    directions = offsets / np.maximum(lengths, 1.0e-9)[:, None]
    # Farther than the map reaches, there are no obstacles: a range may be any number.
    longest = min(lengths.max() - PASSAGE, sum(field.cells.squares.shape) * field.resolution)
    steps = np.arange(PASSAGE, longest, 0.5 * field.resolution)
    # Axes of the samples: beam, step along it.
    local_x = laser[0] + directions[:, :1] * steps
    local_y = laser[1] + directions[:, 1:] * steps
    cosine, sine = math.cos(pose.yaw), math.sin(pose.yaw)
    x = pose.x + cosine * local_x - sine * local_y
    y = pose.y + sine * local_x + cosine * local_y
    are_passed = field.are_occupied(x, y) & (steps < lengths[:, None] - PASSAGE)
    return float(are_passed.any(axis=1).mean())


def _likely(
    free: FreeSpace, likelihoods: Judge, rivals: int, most: int, count: int
) -> NDArray[np.float64]:
    """Returns ``count`` poses, each the likeliest of ``rivals``, or of fewer to evaluate at most ``most`` poses."""
    return free.draw_likely(count, max(1, min(rivals, most // max(1, count))), likelihoods)


def _motion_model(config: AmclConfig) -> MotionModel:
    alphas = (
        config.odom_alpha1,
        config.odom_alpha2,
        config.odom_alpha3,
        config.odom_alpha4,
        config.odom_alpha5,
    )
    return motion_model(config.odom_model_type, alphas)
