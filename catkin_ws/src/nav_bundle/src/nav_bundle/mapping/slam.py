"""SLAM with GMapping's Rao-Blackwellised particle filter (Grisetti, Stachniss and Burgard 2007).

Each particle is a laser trajectory with its own map. Odometry moves the particles with noise, each scan is matched to
each particle's map, and resampling removes unlikely particles once the weights have become uneven. Without ROS.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.error import ObservationError
from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.base.scan import Scan
from nav_bundle.mapping.config import GmappingConfig
from nav_bundle.mapping.slam_kernel import Matching, match
from nav_bundle.mapping.tile_map import TileMaps
from nav_bundle.maps.grid import Grid

SIDEWAYS = 0.3
"""Share of ``srr`` that motion along one axis adds to the noise along the other, as in gmapping."""
REACH = 100.0
"""Longest part of a beam that is registered if ``maxUrange`` is not set [m]; the map needs memory for all it covers."""
SHORT_OF_MAX = 0.01
"""Ranges within this distance [m] of the scan's limit count as no return, as in gmapping."""


@dataclass(frozen=True, eq=False)
class _Beams:
    """A scan's beams in the kernels' format: all valid beams, which of them hit, and the hits used for matching."""

    beams: NDArray[np.float64]
    hits: NDArray[np.uint8]
    matched: NDArray[np.float64]


class Slam:
    """Particles with maps. The map frame coincides with the odometry frame at the first scan.

    Args:
        config: slam_gmapping's parameters.
        generator: source of all randomness; the same seed gives the same results.
    """

    def __init__(self, config: GmappingConfig, generator: np.random.Generator) -> None:
        self._config, self._generator = config, generator
        #: the particles' laser poses, x, y [m], yaw [rad], map frame, shape (particles, 3)
        self.poses = np.zeros((config.particles, 3))
        #: resamplings: number of resamplings so far
        #: unmatched: number of particles whose last scan match did not exceed ``minimumScore``
        self.unmatched = self.resamplings = 0
        self.maps = TileMaps(
            config.particles, config.xmin, config.ymin, config.delta
        )  #: one for each particle
        self._odom: Pose | None = None
        #: the odometry frame's pose in the map, from the best particle at the last used scan; None before the first
        self.map_from_odom: Pose | None = None
        self._logs = np.zeros(config.particles)
        self._sums = np.zeros(config.particles)
        self._distance = self._turn = self._stamp = 0.0
        self._mount: Pose | None = None  # of the last scan's laser, in the robot's frame
        self._used: set[str] = set()  # lasers whose scans were used since the robot last moved

    @property
    def best(self) -> int:
        """Index of the particle whose trajectory explains the scans best."""
        return int(np.argmax(self._sums))

    def weights(self) -> NDArray[np.float64]:
        """Returns the particles' weights since the last resampling, shape (particles,), sum 1."""
        gain = 1.0 / (self._config.ogain * len(self.poses))
        weights = np.exp(gain * (self._logs - self._logs.max()))
        return weights / weights.sum()

    def entropy(self) -> float:
        """Returns the entropy [nat] of the weights; for equal weights, the logarithm of the number of particles."""
        weights = self.weights()
        return float(-(weights * np.log(np.maximum(weights, np.finfo(float).tiny))).sum())

    def grid(self) -> Grid:
        """Returns the best particle's map, from xmin, ymin to xmax, ymax, or larger if the map has grown beyond."""
        config = self._config
        return self.maps.drawn(self.best, config.occ_thresh, config.xmax, config.ymax)

    def observe(self, odom: Pose, scan: Scan, stamp: float, name: str = "") -> bool:
        """Moves the particles by odometry, and uses the scan if the robot has moved far enough since the last used one.

        Call it with every scan: noise is drawn for each odometry step, as in gmapping. Of several lasers each has its
        scan used once the robot has moved.

        Args:
            odom: the robot's odometry pose at the scan's time.
            scan: the laser scan.
            stamp: time of the scan [s].
            name: names the laser, if there are several.

        Returns:
            Whether the scan was used.

        Raises:
            ObservationError: the scan lies too far from the others for one map.
        """
        laser = odom.compose(scan.laser)
        first = self._odom is None
        if self._odom is None:
            self.poses[:] = laser.x, laser.y, laser.yaw
        else:
            self._move(self._remounted(self._odom, scan.laser), laser)
        self._odom = laser
        self._mount = scan.laser
        if first or self._due(stamp):
            self._distance, self._turn, self._stamp = 0.0, 0.0, stamp
            self._used.clear()
        if name in self._used:
            return False
        self._used.add(name)
        beams = self._beams(scan)
        if not self.maps.fits(
            self.poses, float(beams.beams[:, 2].max(initial=0.0)) * self._config.delta
        ):
            raise ObservationError("the robot is too far from its map: has its odometry jumped?")
        if not first:
            self._match(beams)
            self._resample_if_uneven()
        for index, pose in enumerate(self.poses):
            self.maps.register(index, pose, beams.beams, beams.hits)
        self.map_from_odom = Pose(*self.poses[self.best].tolist()).compose(laser.inverse())
        return True

    def _remounted(self, before: Pose, mount: Pose) -> Pose:
        """Moves the particles, which are poses of the laser, to another laser of the robot; returns ``before`` there.

        Args:
            before: odometry pose of the laser whose scan was last observed.
            mount: pose of the laser whose scan is observed now, in the robot's frame.
        """
        if self._mount is None or mount == self._mount:
            return before
        shift = self._mount.inverse().compose(mount)
        cosine, sine = np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2])
        self.poses[:, 0] += cosine * shift.x - sine * shift.y
        self.poses[:, 1] += sine * shift.x + cosine * shift.y
        self.poses[:, 2] += shift.yaw
        return before.compose(shift)

    def _due(self, stamp: float) -> bool:
        config = self._config
        far = self._distance >= config.linearUpdate or self._turn >= config.angularUpdate
        # A stamp before the last one is that of a clock that was set back.
        late = not self._stamp <= stamp <= self._stamp + config.temporalUpdate
        return far or (config.temporalUpdate >= 0.0 and late)

    def _move(self, before: Pose, after: Pose) -> None:
        """Moves every particle by the laser's odometry motion, each with independent noise."""
        step = before.inverse().compose(after)
        length, turn = math.hypot(step.x, step.y), abs(angle_difference(after.yaw, before.yaw))
        if length == 0.0 and turn == 0.0:
            return
        self._distance += length
        self._turn += turn
        config, ahead, aside = self._config, abs(step.x), abs(step.y)
        sigmas = (
            config.srr * (ahead + SIDEWAYS * aside) + config.str * turn,
            config.srr * (aside + SIDEWAYS * ahead) + config.str * turn,
            config.stt * turn + config.srt * length,
        )
        noise = self._generator.standard_normal((len(self.poses), 3)) * sigmas
        x, y, yaw = (noise + np.array([step.x, step.y, step.yaw])).T
        cosine, sine = np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2])
        self.poses[:, 0] += cosine * x - sine * y
        self.poses[:, 1] += sine * x + cosine * y
        self.poses[:, 2] += yaw

    def _beams(self, scan: Scan) -> _Beams:
        """Classifies beams: dropped beyond maxRange; clearing up to maxUrange if at or beyond it; otherwise hits."""
        config = self._config
        longest = config.maxRange if config.maxRange >= 0.0 else scan.range_max - SHORT_OF_MAX
        usable = config.maxUrange if config.maxUrange >= 0.0 else min(longest, REACH)
        ranges = scan.ranges.astype(np.float64)
        # Comparisons with NaN are false, so NaN beams are dropped.
        valid = (ranges >= scan.range_min) & (ranges > 0.0) & (ranges <= longest)
        bearings = scan.angle_min + scan.angle_increment * np.arange(len(ranges))[valid]
        lengths = np.minimum(ranges[valid], usable)
        beams = np.stack([np.cos(bearings), np.sin(bearings), lengths / config.delta], axis=1)
        hits = ranges[valid] < usable
        return _Beams(
            beams, hits.astype(np.uint8), np.ascontiguousarray(beams[hits][:: config.lskip + 1])
        )

    def _match(self, beams: _Beams) -> None:
        config = self._config
        matching = Matching(
            config.sigma,
            config.lsigma,
            config.lstep,
            config.astep,
            config.minimumScore,
            config.iterations,
            config.kernelSize,
        )
        found = np.empty((len(self.poses), 2))
        match(self.poses, beams.matched, self.maps.maps, matching, found)
        self.unmatched = int(np.count_nonzero(found[:, 0] <= config.minimumScore))
        self._logs += found[:, 1]
        self._sums += found[:, 1]

    def _resample_if_uneven(self) -> None:
        """Resamples systematically if the effective number of particles is below ``resampleThreshold``."""
        weights, count = self.weights(), len(self.poses)
        if 1.0 / (weights**2).sum() >= self._config.resampleThreshold * count:
            return
        marks = (self._generator.random() + np.arange(count)) / count
        chosen = np.minimum(np.searchsorted(np.cumsum(weights), marks), count - 1)
        self.poses, self._sums = self.poses[chosen], self._sums[chosen]
        self._logs = np.zeros(count)
        self.maps.resample(chosen)
        self.resamplings += 1
