"""Cross-sections of shapes at one height, as seen by a level laser.

A section consists of segments, rows (ax, ay, ex, ey) [m] of one end and the vector to the other, and circles, rows
(x, y, radius) [m], in the frame in which the shapes' poses are given.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.world.model import Box, Cylinder, Mesh, Plane, Shape, Sphere
from pioneer_gazebo.world.pose import Pose

Triangles = Callable[[Mesh], NDArray[np.float64]]
"""Returns a mesh's triangles, shape (n, 3, 3) [m], scaled, in the mesh's frame."""

PRISM_SIDES = 32
"""Number of sides of the prism that replaces a tilted cylinder."""

_UPRIGHT = 1e-6
_BOX_EDGES = tuple((i, j) for i in range(8) for j in range(i + 1, 8) if (i ^ j) in (1, 2, 4))


@dataclass(frozen=True, slots=True)
class Section:
    """Segments, shape (n, 4), and circles, shape (m, 3), in one plane; float64."""

    segments: NDArray[np.float64]
    circles: NDArray[np.float64]

    @classmethod
    def joined(cls, parts: "Iterable[Section]") -> "Section":
        """Returns all parts combined into one section."""
        parts = list(parts)
        segments = [part.segments for part in parts if len(part.segments)]
        circles = [part.circles for part in parts if len(part.circles)]
        return cls(
            np.ascontiguousarray(np.concatenate(segments)) if segments else np.empty((0, 4)),
            np.ascontiguousarray(np.concatenate(circles)) if circles else np.empty((0, 3)),
        )

    def extremes(self) -> NDArray[np.float64]:
        """Returns points (n, 2) with the same bounding box as the section; none if it is empty."""
        starts, centres, radii = self.segments[:, :2], self.circles[:, :2], self.circles[:, 2:]
        return np.concatenate(
            [starts, starts + self.segments[:, 2:], centres - radii, centres + radii]
        )

    def as_segments(self, sides: int = 24) -> NDArray[np.float64]:
        """Returns the segments, with each circle replaced by a polygon with ``sides`` sides and the same area."""
        parts = [self.segments]
        angles = np.arange(sides) * math.tau / sides
        stretch = math.sqrt(math.tau / (sides * math.sin(math.tau / sides)))
        for x, y, radius in self.circles:
            rim = radius * stretch
            corners = np.column_stack([x + rim * np.cos(angles), y + rim * np.sin(angles)])
            parts.append(_closed(corners))
        return np.ascontiguousarray(np.concatenate(parts))


EMPTY = Section(np.empty((0, 4)), np.empty((0, 3)))


def section_of(shape: Shape, pose: Pose, height: float, triangles: Triangles) -> Section:
    """Returns the cross-section of ``shape`` at ``pose`` with the plane z = ``height`` [m]; empty for a plane shape."""
    match shape:
        case Box():
            return _box(shape, pose, height)
        case Sphere(radius=radius):
            return _sphere(radius, pose, height)
        case Cylinder():
            return _cylinder(shape, pose, height)
        case Mesh():
            return _mesh(triangles(shape), pose, height)
        case Plane():
            return EMPTY


def _closed(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the sides of the closed polygon with these corners, shape (n, 2)."""
    return np.hstack([corners, np.roll(corners, -1, axis=0) - corners])


def _polygon(corners: NDArray[np.float64]) -> Section:
    return Section(_closed(corners), EMPTY.circles)


def _hull(points: NDArray[np.float64]) -> Section:
    """Returns the outline through points on a convex curve."""
    if len(points) < 2:
        return EMPTY
    centre = points.mean(axis=0)
    order = np.argsort(
        np.arctan2(points[:, 1] - centre[1], points[:, 0] - centre[0]), kind="stable"
    )
    return _polygon(points[order])


def _cut_edges(corners: NDArray[np.float64], edges: NDArray[np.intp], height: float) -> Section:
    """Cuts a convex body, given by corners (n, 3) and edges (m, 2), at ``height``."""
    a, b = corners[edges[:, 0]], corners[edges[:, 1]]
    za, zb = a[:, 2] - height, b[:, 2] - height
    crossing = (za <= 0) != (zb <= 0)
    a, b, za, zb = a[crossing], b[crossing], za[crossing], zb[crossing]
    part = (za / (za - zb))[:, None]
    return _hull(a[:, :2] + part * (b[:, :2] - a[:, :2]))


def _box(box: Box, pose: Pose, height: float) -> Section:
    hx, hy, hz = (side / 2 for side in box.size)
    qx, qy, qz, qw = pose.rotation
    if abs(qx) < _UPRIGHT and abs(qy) < _UPRIGHT:
        if abs(height - pose.position[2]) > hz:
            return EMPTY
        c, s = 1 - 2 * qz * qz, 2 * qz * qw
        x, y, _ = pose.position
        corners = np.array([(hx, hy), (-hx, hy), (-hx, -hy), (hx, -hy)])
        return _polygon(corners @ np.array([[c, s], [-s, c]]) + (x, y))
    local = np.array(
        [(hx * sx, hy * sy, hz * sz) for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)]
    )
    return _cut_edges(_placed(local, pose), np.array(_BOX_EDGES), height)


def _placed(points: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    matrix = pose.matrix()
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def _sphere(radius: float, pose: Pose, height: float) -> Section:
    x, y, z = pose.position
    square = radius * radius - (height - z) ** 2
    return Section(EMPTY.segments, np.array([[x, y, math.sqrt(square)]])) if square > 0 else EMPTY


def _cylinder(cylinder: Cylinder, pose: Pose, height: float) -> Section:
    x, y, z = pose.position
    qx, qy, _, _ = pose.rotation
    if abs(qx) < _UPRIGHT and abs(qy) < _UPRIGHT:
        inside = abs(height - z) <= cylinder.length / 2
        return Section(EMPTY.segments, np.array([[x, y, cylinder.radius]])) if inside else EMPTY
    angles = np.arange(PRISM_SIDES) * math.tau / PRISM_SIDES
    rim = np.column_stack(
        [cylinder.radius * np.cos(angles), cylinder.radius * np.sin(angles), np.zeros(PRISM_SIDES)]
    )
    half = np.array([0.0, 0.0, cylinder.length / 2])
    corners = _placed(np.concatenate([rim - half, rim + half]), pose)
    i = np.arange(PRISM_SIDES)
    following = (i + 1) % PRISM_SIDES
    ends = (i, following), (i + PRISM_SIDES, following + PRISM_SIDES), (i, i + PRISM_SIDES)
    edges = np.concatenate([np.column_stack(pair) for pair in ends])
    return _cut_edges(corners, edges, height)


def _mesh(triangles: NDArray[np.float64], pose: Pose, height: float) -> Section:
    """Cuts each triangle; a triangle that meets the plane has exactly two sides that cross it."""
    corners = _placed(triangles.reshape(-1, 3), pose).reshape(-1, 3, 3)
    above = corners[:, :, 2] > height
    cut = corners[above.any(axis=1) & ~above.all(axis=1)]
    if not len(cut):
        return EMPTY
    following = np.roll(cut, -1, axis=1)
    za, zb = cut[:, :, 2] - height, following[:, :, 2] - height
    crossing = (za > 0) != (zb > 0)
    part = np.where(crossing, za / np.where(crossing, za - zb, 1.0), 0.0)
    points = (cut + part[:, :, None] * (following - cut))[:, :, :2]
    ends = points[crossing].reshape(-1, 2, 2)
    return Section(np.hstack([ends[:, 0], ends[:, 1] - ends[:, 0]]), EMPTY.circles)
