"""Top-down image of the world: solids, robots with scans and names, a scale bar. Drawn with Pillow."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pioneer_gazebo.world.section import Section

PAPER, WALL, SOLID, INK = (250, 250, 247), (40, 44, 52), (150, 156, 166), (20, 20, 20)
_MEETS = 1e-6
"""Points closer than this are the same vertex [m]."""
COLOURS = (
    (214, 69, 65),
    (38, 122, 189),
    (39, 158, 96),
    (214, 137, 16),
    (125, 70, 168),
    (22, 150, 160),
)
"""Robot colours, used in turn."""
_FINER = 2
"""Supersampling factor; the image is drawn larger and then reduced, which smooths its edges."""
_BAR_LENGTHS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
"""Possible lengths of the scale bar [m]."""


@dataclass(frozen=True, slots=True)
class Shown:
    """A moving model in the image."""

    name: str  #: label drawn beside it
    #: x, y, yaw: pose of its base in the world [m, rad]
    x: float
    y: float
    yaw: float
    outline: NDArray[np.float64]  #: segments (n, 4) in the frame of its base [m], as in `Section`
    hits: NDArray[np.float64]  #: shape (m, 2), end points of its beams in the world [m]
    eye: tuple[float, float]  #: origin of the beams in the world [m]


class PlanImage:
    """A canvas in metres: x to the right, y up."""

    def __init__(self, solids: Sequence[Section], shown: Sequence[Shown], side: int) -> None:
        """Draws everything on a canvas that fits it; its longer side has ``side`` pixels."""
        self._low, high = _bounds(Section.joined(solids), shown)
        width, height = high - self._low
        scale = (side - 1) / max(width, height)
        size = max(1, round(width * scale) + 1), max(1, round(height * scale) + 1)
        self._scale, self._size = scale * _FINER, (size[0] * _FINER, size[1] * _FINER)
        canvas = Image.new("RGB", self._size, PAPER)
        self._draw = ImageDraw.Draw(canvas, "RGBA")
        self._font = _font(round(_FINER * max(11.0, side / 80)))
        for solid in solids:
            self._solid(solid)
        for number, one in enumerate(shown):
            self._scan(one, COLOURS[number % len(COLOURS)])
        for number, one in enumerate(shown):
            self._body(one, COLOURS[number % len(COLOURS)])
        self._bar(width)
        self.image = canvas.resize(size, Image.Resampling.BOX)

    def _at(self, x: float, y: float) -> tuple[float, float]:
        return (x - self._low[0]) * self._scale, self._size[1] - _FINER - (
            y - self._low[1]
        ) * self._scale

    def _solid(self, solid: Section) -> None:
        for corners in closed_lines(solid.segments):
            self._draw.polygon([self._at(x, y) for x, y in corners], fill=SOLID)
        for x, y, radius in solid.circles:
            box = [self._at(x - radius, y + radius), self._at(x + radius, y - radius)]
            self._draw.ellipse(box, fill=SOLID, outline=WALL, width=2 * _FINER)
        for ax, ay, ex, ey in solid.segments:
            self._draw.line(
                [self._at(ax, ay), self._at(ax + ex, ay + ey)], fill=WALL, width=2 * _FINER
            )

    def _bar(self, width: float) -> None:
        """Draws the scale bar at the lower left: the longest length within a fifth of the image width."""
        length = max((one for one in _BAR_LENGTHS if one <= width / 5), default=_BAR_LENGTHS[0])
        left, bottom = 8.0 * _FINER, self._size[1] - 8.0 * _FINER
        right = left + length * self._scale
        self._draw.line([(left, bottom), (right, bottom)], fill=INK, width=2 * _FINER)
        for end in (left, right):
            self._draw.line([(end, bottom - 4 * _FINER), (end, bottom)], fill=INK, width=2 * _FINER)
        self._text((left + 3 * _FINER, bottom - 6 * _FINER), f"{length:g} m", "ls")

    def _text(self, place: tuple[float, float], text: str, anchor: str) -> None:
        if isinstance(self._font, ImageFont.FreeTypeFont):
            outline = {"stroke_width": 2 * _FINER, "stroke_fill": PAPER}
            self._draw.text(place, text, fill=INK, font=self._font, anchor=anchor, **outline)
        else:
            self._draw.text((place[0], place[1] - 11), text, fill=INK, font=self._font)

    def _scan(self, one: Shown, colour: tuple[int, int, int]) -> None:
        eye = self._at(*one.eye)
        for x, y in one.hits:
            end = self._at(x, y)
            self._draw.line([eye, end], fill=(*colour, 40))
            radius = 1.5 * _FINER
            self._draw.ellipse(
                [end[0] - radius, end[1] - radius, end[0] + radius, end[1] + radius], fill=colour
            )

    def _body(self, one: Shown, colour: tuple[int, int, int]) -> None:
        c, s = math.cos(one.yaw), math.sin(one.yaw)

        def placed(x: float, y: float) -> tuple[float, float]:
            return self._at(one.x + c * x - s * y, one.y + s * x + c * y)

        for corners in closed_lines(one.outline):
            self._draw.polygon([placed(x, y) for x, y in corners], fill=(*colour, 150))
        for ax, ay, ex, ey in one.outline:
            self._draw.line(
                [placed(ax, ay), placed(ax + ex, ay + ey)], fill=colour, width=2 * _FINER
            )
        if len(one.hits):
            self._draw.line([placed(0.0, 0.0), placed(0.4, 0.0)], fill=INK, width=2 * _FINER)
        px, py = self._at(one.x, one.y)
        self._text((px, py - 0.4 * self._scale - 2 * _FINER), one.name, "ms")


def closed_lines(segments: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Yields the vertices, shape (n, 2), of each closed run of consecutive segments (n, 4).

    Their insides are solid. Segments of a mesh are unordered and therefore skipped.
    """
    begin = 0
    for number, (ax, ay, ex, ey) in enumerate(segments):
        closes = math.dist((ax + ex, ay + ey), segments[begin, :2]) < _MEETS
        if closes and number > begin + 1:
            yield segments[begin : number + 1, :2]
        goes_on = (
            number + 1 < len(segments)
            and math.dist((ax + ex, ay + ey), segments[number + 1, :2]) < _MEETS
        )
        if closes or not goes_on:
            begin = number + 1


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    try:
        return ImageFont.truetype("DejaVuSans.ttf", size)
    except OSError:
        return ImageFont.load_default()


def _bounds(
    walls: Section, shown: Sequence[Shown]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the minimum and maximum x, y [m] of the view, with margins."""
    parts = [walls.extremes()]
    parts += [np.array([[one.x - 1.0, one.y - 1.0], [one.x + 1.0, one.y + 1.0]]) for one in shown]
    points = np.concatenate(parts)
    if not len(points):
        points = np.array([[-5.0, -5.0], [5.0, 5.0]])
    low, high = points.min(axis=0), points.max(axis=0)
    # Leaves room for the scale bar, also in large worlds.
    return low - (0.5, max(0.5, 0.04 * (high - low).max())), high + 0.5
