"""Prisms over polygons: SDF's ``<polyline>``, as triangles."""

from collections.abc import Sequence
from itertools import combinations

Point = tuple[float, float]
"""x, y [m]."""

Corner = tuple[float, float, float]

CORNERS_AT_MOST = 300
"""A polygon with more corners takes too long to divide into triangles."""


def prism(polygon: Sequence[Point], height: float) -> tuple[Corner, ...]:
    """Returns the corners of a prism's triangles, three for each, from z = 0 to ``height`` [m].

    Args:
        polygon: its corners in either direction; the last one may repeat the first.
        height: above 0 [m].

    Raises:
        ValueError: the polygon has fewer than three corners, too many, no area, or meets itself.
    """
    corners = [point for index, point in enumerate(polygon) if point != polygon[index - 1]]
    if len(set(corners)) < len(corners):
        raise ValueError("comes to a point twice")
    if not 3 <= len(corners) <= CORNERS_AT_MOST:
        raise ValueError(f"needs 3 to {CORNERS_AT_MOST} different points (got {len(corners)})")
    if _crosses_itself(corners):
        raise ValueError("crosses itself")
    if _area(corners) < 0:
        corners.reverse()
    faces: list[Corner] = []
    for a, b, c in triangles_of_polygon(corners):
        faces += [(*a, height), (*b, height), (*c, height)]
        faces += [(*a, 0.0), (*c, 0.0), (*b, 0.0)]
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        faces += [(*a, 0.0), (*b, 0.0), (*b, height)]
        faces += [(*a, 0.0), (*b, height), (*a, height)]
    return tuple(faces)


def triangles_of_polygon(corners: Sequence[Point]) -> list[tuple[Point, Point, Point]]:
    """Returns triangles that cover a counter-clockwise polygon, by cutting off one ear after the other.

    Raises:
        ValueError: it has no area or crosses itself.
    """
    left = list(corners)
    found: list[tuple[Point, Point, Point]] = []
    while len(left) > 3:
        ear = next((i for i in range(len(left)) if _is_ear(left, i)), None)
        if ear is None:
            flat = next((i for i in range(len(left)) if _turn(*_around(left, i)) == 0), None)
            if flat is None:
                raise ValueError("crosses itself")
            del left[flat]
            continue
        found.append(_around(left, ear))
        del left[ear]
    if _turn(left[0], left[1], left[2]) > 0:
        found.append((left[0], left[1], left[2]))
    if not found:
        raise ValueError("has no area")
    return found


def _around(corners: Sequence[Point], index: int) -> tuple[Point, Point, Point]:
    return corners[index - 1], corners[index], corners[(index + 1) % len(corners)]


def _is_ear(corners: Sequence[Point], index: int) -> bool:
    """Returns whether a corner is convex, and no other corner lies in its triangle."""
    a, b, c = _around(corners, index)
    if _turn(a, b, c) <= 0:
        return False
    others = (point for point in corners if point not in (a, b, c))
    return not any(
        _turn(a, b, point) >= 0 and _turn(b, c, point) >= 0 and _turn(c, a, point) >= 0
        for point in others
    )


def _turn(a: Point, b: Point, c: Point) -> float:
    """Returns twice the area of a triangle: above 0 if its corners run counter-clockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _crosses_itself(corners: Sequence[Point]) -> bool:
    """Returns whether two sides cross, other than at a corner."""
    sides = list(zip(corners, [*corners[1:], corners[0]], strict=True))
    return any(_cross(*one, *other) for one, other in combinations(sides, 2))


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    return _turn(a, b, c) * _turn(a, b, d) < 0 and _turn(c, d, a) * _turn(c, d, b) < 0


def _area(corners: Sequence[Point]) -> float:
    pairs = zip(corners, [*corners[1:], corners[0]], strict=True)
    return sum(a[0] * b[1] - a[1] * b[0] for a, b in pairs) / 2
