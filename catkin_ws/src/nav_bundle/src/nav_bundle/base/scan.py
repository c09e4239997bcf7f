"""Planar laser scans."""

import functools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose

LONGEST = 1.0e4
"""Largest range of a sensor [m]; stands for a range without limit."""


_SHORT_OF_MAXIMUM = 1.0e-4


@dataclass(frozen=True, eq=False)
class Scan:
    """One planar laser scan."""

    #: measured distances [m], shape (n,); NaN and values at or beyond ``range_max`` mean no return
    ranges: NDArray[np.float32] = field(repr=False)
    angle_min: float  #: direction of the first beam [rad] in the laser's frame
    angle_increment: float  #: angle between beams [rad]; negative for a laser mounted upside down
    range_min: float  #: ranges up to this one count as no return [m]
    range_max: float  #: maximum range [m], positive and at most ``LONGEST``
    laser: Pose  #: pose of the laser in the robot's frame

    def thinned(self, beams: int, shortest: float, longest: float) -> "Beams":
        """Returns about ``beams`` beams spread evenly over the scan; the range limits [m] apply if positive."""
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
    """The used beams of a scan: ``ranges`` [m] and ``bearings`` [rad, laser frame], both shape (m,)."""

    ranges: NDArray[np.float64]
    bearings: NDArray[np.float64]
    range_max: float
    laser: Pose

    def end_points(self) -> NDArray[np.float64]:
        """Returns the end points (x, y) [m, robot frame], shape (k, 2), of the beams with a return."""
        seen = self.ranges < self.range_max
        ranges, angles = self.ranges[seen], self.bearings[seen] + self.laser.yaw
        laser = np.array([self.laser.x, self.laser.y])
        return laser + np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)


def points_from_ranges(
    ranges: NDArray[np.float32],
    first_angle: float,
    angle_step: float,
    shortest: float,
    longest: float,
    inf_is_valid: bool,
) -> NDArray[np.float64]:
    """Converts laser returns to points (n, 3) [m] in the sensor's frame; ranges without a return give no point.

    With ``inf_is_valid``, an infinite range gives a point just short of ``longest`` [m].
    """
    if inf_is_valid:
        ranges = np.where(np.isposinf(ranges), np.float32(longest - _SHORT_OF_MAXIMUM), ranges)
    directions = _directions(len(ranges), first_angle, angle_step)
    valid = (ranges >= shortest) & (ranges < longest)
    return directions[valid] * ranges[valid, None]


@functools.lru_cache(maxsize=8)
def _directions(count: int, first_angle: float, angle_step: float) -> NDArray[np.float64]:
    angles = first_angle + angle_step * np.arange(count)
    return np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)


@dataclass(frozen=True, eq=False)
class Picture:
    """A laser scan: sensor pose and points (n, 2) [m], both in the odometry frame."""

    sensor: Pose
    points: NDArray[np.float64]

    def ranges(self, bearings: NDArray[np.float64], sensor: Pose) -> NDArray[np.float64]:
        """Returns the ranges [m] to the points at ``bearings`` [rad] as seen from ``sensor``."""
        away = self.points - (sensor.x, sensor.y)
        angles = np.arctan2(away[:, 1], away[:, 0]) - sensor.yaw
        closeness = 1.0 / np.maximum(np.hypot(away[:, 0], away[:, 1]), 0.01)
        return 1.0 / np.interp(bearings, angles, closeness, period=2.0 * np.pi)
