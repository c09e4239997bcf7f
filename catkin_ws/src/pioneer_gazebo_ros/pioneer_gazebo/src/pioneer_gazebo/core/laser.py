"""Planar laser: distances from a level sensor to walls and to outlines that move, with SDF's gaussian noise."""

import math
import zlib

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.core.robot import LaserSensor, SonarSensor
from pioneer_gazebo.core.section import Section
from pioneer_gazebo.kernels import laser as kernel
from pioneer_gazebo.kernels.laser import Fan, Sensor

CELLS_AT_MOST = 1 << 20
"""The grid's cells grow where the world is so large that it would have more."""

CELL = 1.0
"""Side of a grid cell [m] where the world allows it."""


class WallIndex:
    """A section of the standing world in a grid, ready to be cast against. Does not change once made."""

    def __init__(self, section: Section, cell: float = CELL) -> None:
        low, high = _bounds(section)
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
        """Writes each beam's distance [m] to ``out``, ``fan.reach`` where nothing is met.

        Args:
            sensor: in the section's frame.
            fan: the beams.
            out: float64, one value a beam.
        """
        kernel.cast(self._walls, self._starts, self._items, sensor, fan, out)


def _bounds(section: Section) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the least and greatest x, y [m] of a section, the origin for an empty one."""
    corners = [section.segments[:, :2], section.segments[:, :2] + section.segments[:, 2:]]
    corners += [section.circles[:, :2] - section.circles[:, 2:], section.circles[:, :2] + section.circles[:, 2:]]
    points = np.concatenate(corners)
    return (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))


class Movers:
    """Outlines of everything that moves, at one height; poses are rows of an array that the owner updates."""

    def __init__(self, outlines: list[NDArray[np.float64]]) -> None:
        """Takes one outline a mover: segments (n, 4) in the mover's frame."""
        self._outlines = kernel.Outlines(
            np.ascontiguousarray(np.concatenate([np.empty((0, 4)), *outlines])),
            np.cumsum([0] + [len(outline) for outline in outlines]).astype(np.int32),
            np.array([_radius(outline) for outline in outlines], dtype=np.float64),
        )

    def shorten(self, poses: NDArray[np.float64], own: int, sensor: Sensor, fan: Fan, out: NDArray[np.float64]) -> None:
        """Shortens the beams in ``out`` that an outline cuts.

        Args:
            poses: (movers, 3) x, y, yaw [m, rad], C-contiguous.
            own: the mover that carries the sensor, which does not see itself; -1 for none.
            sensor: where the beams start.
            fan: the beams.
            out: distances [m] so far.
        """
        kernel.cast_movers(self._outlines, poses, own, sensor, fan, out)


def _radius(outline: NDArray[np.float64]) -> float:
    ends = np.concatenate([outline[:, :2], outline[:, :2] + outline[:, 2:]])
    return float(np.sqrt((ends**2).sum(axis=1)).max()) if len(ends) else 0.0


def generator_for(seed: int, *names: str) -> np.random.Generator:
    """Returns a generator of its own for what ``names`` name: adding others changes nothing for it."""
    return np.random.default_rng([seed & 0xFFFFFFFF, *(zlib.crc32(name.encode()) for name in names)])


def laser_of_sonar(config: SonarSensor) -> LaserSensor:
    """Returns the fan of beams that stands for a sonar's cone: its reading is that of the nearest thing met."""
    return LaserSensor(
        config.name, config.link, config.pose, config.update_rate, config.frame,
        samples=max(2, config.samples), min_angle=-config.fov / 2, max_angle=config.fov / 2,
        min_range=config.min_range, max_range=config.max_range, noise_stddev=config.gaussianNoise, topic=config.topic,
    )  # fmt: skip


class Laser:
    """One laser on one robot: turns distances into ranges as Gazebo's ray sensor does.

    Noise comes on what was met only and is kept within the range limits. What is farther than the greatest range
    is +inf, nearer than the least −inf (REP 117, Gazebo 11).
    """

    def __init__(self, config: LaserSensor, generator: np.random.Generator) -> None:
        self.config = config
        self._generator = generator
        self._distances = np.empty(config.samples)
        self._noise = np.zeros(config.samples)
        self.increment = (config.max_angle - config.min_angle) / max(1, config.samples - 1)

    def ranges(
        self,
        walls: WallIndex,
        movers: Movers,
        poses: NDArray[np.float64],
        own: int,
        sensor: Sensor,
    ) -> NDArray[np.float64]:
        """Returns the ranges [m] of a scan from ``sensor``; the array is overwritten by the next scan."""
        out = self._distances
        fan = Fan(self.config.min_angle, self.increment, self.config.max_range)
        walls.cast(sensor, fan, out)
        movers.shorten(poses, own, sensor, fan, out)
        return self.measured(out)

    def reseed(self, generator: np.random.Generator) -> None:
        """Restarts the noise."""
        self._generator = generator

    def measured(self, out: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turns true distances into ranges in place: resolution, noise, limits."""
        config = self.config
        if config.noise_stddev > 0:
            self._generator.standard_normal(out=self._noise)
        limits = (config.min_range, config.max_range)
        reading = kernel.Reading(config.noise_mean, config.noise_stddev, config.resolution, *limits)
        kernel.measure(out, self._noise, reading)
        return out
