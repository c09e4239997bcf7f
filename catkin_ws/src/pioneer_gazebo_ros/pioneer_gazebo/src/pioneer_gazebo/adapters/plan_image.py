"""A picture of the world from above: what stands, and robots with their scans and names. Drawn with Pillow."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pioneer_gazebo.core.section import Section

PAPER, WALL, INK = (250, 250, 247), (40, 44, 52), (20, 20, 20)
COLOURS = ((214, 69, 65), (38, 122, 189), (39, 158, 96), (214, 137, 16), (125, 70, 168), (22, 150, 160))
"""Robots take these in turn."""


@dataclass(frozen=True, slots=True)
class Shown:
    """One model that moves.

    Attributes:
        name: written beside it.
        x, y, yaw: of its base in the world [m, rad].
        outline: segments (n, 4) in its base's frame [m], as in `Section`.
        hits: shape (m, 2), where its beams ended, in the world [m].
        eye: where they began [m].
    """

    name: str
    x: float
    y: float
    yaw: float
    outline: NDArray[np.float64]
    hits: NDArray[np.float64]
    eye: tuple[float, float]


class PlanImage:
    """A canvas in metres: x to the right, y up."""

    def __init__(self, walls: Section, shown: Sequence[Shown], side: int) -> None:
        """Makes a canvas that holds everything; its longer side has ``side`` pixels."""
        self._low, high = _bounds(walls, shown)
        width, height = high - self._low
        self._scale = (side - 1) / max(width, height)
        self._size = max(1, round(width * self._scale) + 1), max(1, round(height * self._scale) + 1)
        self.image = Image.new("RGB", self._size, PAPER)
        self._draw = ImageDraw.Draw(self.image, "RGBA")
        self._font = ImageFont.load_default()
        self._walls(walls)
        for number, one in enumerate(shown):
            self._scan(one, COLOURS[number % len(COLOURS)])
        for number, one in enumerate(shown):
            self._body(one, COLOURS[number % len(COLOURS)])

    def _at(self, x: float, y: float) -> tuple[float, float]:
        return (x - self._low[0]) * self._scale, self._size[1] - 1 - (y - self._low[1]) * self._scale

    def _walls(self, walls: Section) -> None:
        for ax, ay, ex, ey in walls.segments:
            self._draw.line([self._at(ax, ay), self._at(ax + ex, ay + ey)], fill=WALL, width=2)
        for x, y, radius in walls.circles:
            self._draw.ellipse(
                [self._at(x - radius, y + radius), self._at(x + radius, y - radius)], outline=WALL, width=2
            )

    def _scan(self, one: Shown, colour: tuple[int, int, int]) -> None:
        eye = self._at(*one.eye)
        for x, y in one.hits:
            end = self._at(x, y)
            self._draw.line([eye, end], fill=(*colour, 40))
            self._draw.ellipse([end[0] - 1.5, end[1] - 1.5, end[0] + 1.5, end[1] + 1.5], fill=colour)

    def _body(self, one: Shown, colour: tuple[int, int, int]) -> None:
        c, s = math.cos(one.yaw), math.sin(one.yaw)
        for ax, ay, ex, ey in one.outline:
            ends = [(one.x + c * x - s * y, one.y + s * x + c * y) for x, y in ((ax, ay), (ax + ex, ay + ey))]
            self._draw.line([self._at(*end) for end in ends], fill=colour, width=2)
        self._draw.line([self._at(one.x, one.y), self._at(one.x + 0.4 * c, one.y + 0.4 * s)], fill=INK, width=2)
        px, py = self._at(one.x, one.y)
        self._draw.text((px + 0.35 * self._scale + 3, py - 12), one.name, fill=INK, font=self._font)


def _bounds(walls: Section, shown: Sequence[Shown]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the least and greatest x, y [m] to be seen, with a margin."""
    parts = [walls.segments[:, :2], walls.segments[:, :2] + walls.segments[:, 2:]]
    parts += [walls.circles[:, :2] - walls.circles[:, 2:], walls.circles[:, :2] + walls.circles[:, 2:]]
    parts += [np.array([[one.x - 1.0, one.y - 1.0], [one.x + 1.0, one.y + 1.0]]) for one in shown]
    points = np.concatenate(parts)
    if not len(points):
        points = np.array([[-5.0, -5.0], [5.0, 5.0]])
    return points.min(axis=0) - 0.5, points.max(axis=0) + 0.5
