"""Distances between points and line segments [m]."""

import math

Point = tuple[float, float]
Segment = tuple[Point, Point]


def distance_to_segment(point: Point, start: Point, end: Point) -> float:
    """Returns the distance from ``point`` to the nearest point between ``start`` and ``end``."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    square = dx * dx + dy * dy
    share = (
        0.0 if square == 0.0 else ((point[0] - start[0]) * dx + (point[1] - start[1]) * dy) / square
    )
    share = min(1.0, max(0.0, share))
    return math.hypot(point[0] - start[0] - share * dx, point[1] - start[1] - share * dy)


def distance_between_segments(one: Segment, other: Segment) -> float:
    """Returns the distance between two segments; 0 if they cross."""
    if _sides_differ(one, other) and _sides_differ(other, one):
        return 0.0
    ends = [distance_to_segment(point, *other) for point in one] + [
        distance_to_segment(point, *one) for point in other
    ]
    return min(ends)


def _sides_differ(line: Segment, ends: Segment) -> bool:
    """Returns whether the ends lie strictly on opposite sides of the line."""
    (x, y), (to_x, to_y) = line
    left, right = ((to_x - x) * (end[1] - y) - (to_y - y) * (end[0] - x) for end in ends)
    return left * right < 0.0
