"""Planar laser: ray casts from a level sensor against walls and moving outlines, with SDF's Gaussian noise."""

import math

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.laser import laser_kernel as kernel
from pioneer_gazebo.laser.laser_kernel import Fan, Sensor
from pioneer_gazebo.noise import Noise
from pioneer_gazebo.world.robot import LaserSensor, SonarSensor
from pioneer_gazebo.world.section import Section

CELLS_AT_MOST = 1 << 20
"""Maximum number of grid cells; larger worlds get larger cells."""

CELL = 1.0
"""Default side of a grid cell [m]."""


class WallIndex:
    """Immutable grid index of a section of the static world, for ray casts."""

    def __init__(self, section: Section, cell: float = CELL) -> None:
        points = section.extremes()
        low, high = (
            (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
        )
        span = np.maximum(high - low, cell)
        side = max(cell, math.sqrt(float(span[0] * span[1]) / CELLS_AT_MOST))
        cols, rows = (int((s + 2e-3) / side) + 1 for s in span)
        corner = (float(low[0]) - 1e-3, float(low[1]) - 1e-3)
        self._walls = kernel.Walls(section.segments, section.circles, *corner, side, rows, cols)
        counts = np.zeros(rows * cols, dtype=np.int32)
        kernel.count_items(self._walls, counts)
        self._starts = np.zeros(len(counts) + 1, dtype=np.int32)
        np.cumsum(counts, out=self._starts[1:])
        self._items = np.zeros(max(1, int(self._starts[-1])), dtype=np.int32)
        kernel.fill_items(self._walls, self._starts[:-1].copy(), self._items)

    def cast(self, sensor: Sensor, fan: Fan, out: NDArray[np.float64]) -> None:
        """Writes each beam's distance [m] to ``out``, one value per beam; ``sensor`` is in the section's frame."""
        kernel.cast(self._walls, self._starts, self._items, sensor, fan, out)


class Movers:
    """Outlines of all moving entities at one height; poses are rows of an array that the owner updates."""

    def __init__(self, outlines: list[NDArray[np.float64]]) -> None:
        """Takes one outline per mover: segments (n, 4) in the mover's frame."""
        self._outlines = kernel.Outlines(
            np.ascontiguousarray(np.concatenate([np.empty((0, 4)), *outlines])),
            np.cumsum([0] + [len(outline) for outline in outlines]).astype(np.int32),
            np.array([_radius(outline) for outline in outlines], dtype=np.float64),
        )

    def shorten(
        self,
        poses: NDArray[np.float64],
        own: int,
        sensor: Sensor,
        fan: Fan,
        out: NDArray[np.float64],
    ) -> None:
        """Shortens the beams in ``out`` that hit an outline; arguments as for `kernel.cast_movers`."""
        kernel.cast_movers(self._outlines, poses, own, sensor, fan, out)


def _radius(outline: NDArray[np.float64]) -> float:
    ends = np.concatenate([outline[:, :2], outline[:, :2] + outline[:, 2:]])
    return float(np.sqrt((ends**2).sum(axis=1)).max()) if len(ends) else 0.0


def laser_of_sonar(config: SonarSensor) -> LaserSensor:
    """Returns the fan of beams that models a sonar's cone; its reading is that of `Laser.nearest`."""
    return LaserSensor(
        config.name, config.link, config.pose, config.update_rate, config.frame,
        samples=max(1, config.samples), min_angle=-config.fov / 2, max_angle=config.fov / 2,
        min_range=config.min_range, max_range=config.max_range, noise_stddev=config.gaussianNoise, topic=config.topic,
    )  # fmt: skip


class Laser:
    """One laser on one robot; converts distances to ranges like Gazebo's ray sensor.

    Only hits get noise, and stay within the range limits. A distance beyond the maximum range becomes +inf, one below
    the minimum range −inf (REP 117, Gazebo 11). Ranges are not rounded: Gazebo only reports ``<resolution>``.
    """

    def __init__(self, config: LaserSensor, noise: Noise) -> None:
        self.config = config
        self._noise = noise
        self._distances = np.empty(config.samples)
        self._draws = np.zeros(config.samples)
        #: first: angle of the first beam [rad]; a single beam lies in the middle of the fan
        #: last: angle of the last beam [rad]
        #: increment: angle between beams [rad]
        self.first, self.last = config.min_angle, config.max_angle
        if config.samples == 1:
            self.first = self.last = (config.min_angle + config.max_angle) / 2
        self.increment = (self.last - self.first) / max(1, config.samples - 1)

    def distances(
        self,
        walls: WallIndex,
        movers: Movers,
        poses: NDArray[np.float64],
        own: int,
        sensor: Sensor,
        upside_down: bool = False,
    ) -> NDArray[np.float64]:
        """Returns the true distances [m] of a level scan; the array is overwritten by the next scan.

        Args:
            walls: the static world at the sensor's height.
            movers: the outlines of moving bodies at that height.
            poses: of the movers, as for `Movers.shorten`.
            own: row of the mover that carries the sensor.
            sensor: where it is, and where its x axis points.
            upside_down: whether its axis points down, so that its angles count clockwise in the world.
        """
        out = self._distances
        turn = -1.0 if upside_down else 1.0
        fan = Fan(turn * self.first, turn * self.increment, self.config.max_range)
        walls.cast(sensor, fan, out)
        movers.shorten(poses, own, sensor, fan, out)
        return out

    def distances_to(self, section: Section) -> NDArray[np.float64]:
        """Returns the true distances [m] of a scan to what is in the sensor's frame; overwritten by the next scan."""
        fan = Fan(self.first, self.increment, self.config.max_range)
        WallIndex(section).cast(Sensor(0.0, 0.0, 0.0), fan, self._distances)
        return self._distances

    def measured(self, out: NDArray[np.float64], tick: int) -> NDArray[np.float64]:
        """Converts true distances to the ranges read at ``tick`` in place: noise, limits."""
        config = self.config
        if config.noise_stddev > 0:
            self._noise.at(tick).standard_normal(out=self._draws)
        limits = (config.min_range, config.max_range)
        reading = kernel.Reading(config.noise_mean, config.noise_stddev, *limits)
        kernel.measure(out, self._draws, reading)
        return out

    def nearest(self, distances: NDArray[np.float64], tick: int) -> float:
        """Returns a sonar's reading [m] at ``tick``: the nearest of its beams, with the noise of one reading.

        Noise on each beam would make the shortest one too short by more than its deviation.
        """
        config = self.config
        nearest = float(distances.min())
        if config.min_range <= nearest < config.max_range and config.noise_stddev > 0:
            draw = float(self._noise.at(tick).standard_normal())
            nearest += config.noise_mean + config.noise_stddev * draw
        return min(max(nearest, config.min_range), config.max_range)
