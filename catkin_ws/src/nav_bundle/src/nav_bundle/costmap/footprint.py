"""The robot's footprint: its outline projected onto the ground."""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.error import NavigationError
from nav_bundle.base.pose import Pose

_CIRCLE_VERTICES = 16
_LARGEST = 1000.0
"""Farthest that a footprint and its padding may reach [m]; a larger one is a mistake."""


class FootprintError(NavigationError):
    """A footprint that is not a valid polygon."""


class Footprint:
    """A polygon around the robot's origin."""

    def __init__(self, vertices: NDArray[np.float64], padding: float = 0.0) -> None:
        #: float64, shape (n, 2) [m], in the robot's frame, n >= 3
        self.vertices: NDArray[np.float64] = np.ascontiguousarray(
            vertices + np.sign(vertices) * padding, np.float64
        )
        following = np.roll(self.vertices, -1, axis=0)
        #: radius of the largest circle around the origin inside the polygon [m]
        self.inscribed_radius = min(
            _distance_to_segment(*first, *second)
            for first, second in zip(self.vertices, following, strict=True)
        )
        #: radius of the smallest circle around the origin that contains the polygon [m]
        self.circumscribed_radius = float(np.hypot(self.vertices[:, 0], self.vertices[:, 1]).max())

    def outline(self, pose: Pose) -> NDArray[np.float64]:
        """Returns the vertices, shape (n, 2) [m], of the footprint at ``pose``, in the frame of ``pose``."""
        return np.stack(pose.apply(*self.vertices.T), axis=1)


def footprint_from_parameters(polygon: Any, robot_radius: float, padding: float) -> Footprint:
    """Returns the footprint for costmap_2d's parameters: a polygon (list or text), or a circle if none is given.

    Raises:
        FootprintError: fewer than three vertices, or not a list of pairs of numbers.
    """
    if max(abs(robot_radius), abs(padding)) > _LARGEST:
        raise FootprintError(f"robot_radius and footprint_padding must be below {_LARGEST:g} m")
    if polygon in (None, "", [], "[]"):
        angles = np.arange(_CIRCLE_VERTICES) * (math.tau / _CIRCLE_VERTICES)
        return Footprint(robot_radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), padding)
    return Footprint(_vertices(polygon), padding)


_TOKEN = re.compile(r"[\[\]]|[^\[\],\s]+")
"""A bracket, or whatever stands between brackets, commas and white space."""


def _points_from_text(text: str) -> list[list[float]]:
    """Returns the points of a text such as ``[[.3, .2], [+0.3, -1.], [0 1],]``, read as leniently as costmap_2d does.

    Raises:
        ValueError: brackets do not match, or what stands between them is no number.
    """
    points: list[list[float]] = []
    depth = 0
    for token in _TOKEN.findall(text):
        if token == "[":
            depth += 1
            if depth == 2:
                points.append([])
        elif token == "]":
            depth -= 1
        elif depth == 2:
            points[-1].append(float(token))
        else:
            raise ValueError(f"{token!r} stands outside of a point")
        if not 0 <= depth <= 2:
            raise ValueError("its brackets do not match")
    if depth:
        raise ValueError("its brackets do not match")
    return points


def _vertices(polygon: str | Sequence[Any]) -> NDArray[np.float64]:
    try:
        listed = _points_from_text(polygon) if isinstance(polygon, str) else polygon
        vertices = np.array(listed, np.float64)
    except (ValueError, TypeError) as error:
        raise FootprintError(
            f"footprint must be a list of [x, y] pairs, not {polygon!r}"
        ) from error
    if (
        vertices.ndim != 2
        or vertices.shape[1] != 2
        or len(vertices) < 3
        or not np.isfinite(vertices).all()
    ):
        raise FootprintError(f"footprint must have at least three [x, y] vertices, not {polygon!r}")
    if np.abs(vertices).max() > _LARGEST:
        raise FootprintError(f"footprint must stay within {_LARGEST:g} m, not {polygon!r}")
    return vertices


def _distance_to_segment(x_0: float, y_0: float, x_1: float, y_1: float) -> float:
    """Returns the distance from the origin to the segment."""
    dx, dy = x_1 - x_0, y_1 - y_0
    squared = dx * dx + dy * dy
    along = 0.0 if squared == 0.0 else min(1.0, max(0.0, -(x_0 * dx + y_0 * dy) / squared))
    return math.hypot(x_0 + along * dx, y_0 + along * dy)
