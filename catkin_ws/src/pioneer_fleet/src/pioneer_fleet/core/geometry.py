"""Poses in the plane."""

import dataclasses
import itertools
import math

Points = list[tuple[float, float]]
"""Positions along a line [m]."""


@dataclasses.dataclass(frozen=True, slots=True)
class Pose:
    """A position [m] and a heading [rad], or the transform from that frame into its parent."""

    x: float
    y: float
    yaw: float = 0.0

    def compose(self, inner: "Pose") -> "Pose":
        """Returns ``inner``, given in this pose's frame, in this pose's parent frame."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return Pose(
            self.x + cos * inner.x - sin * inner.y,
            self.y + sin * inner.x + cos * inner.y,
            normalised(self.yaw + inner.yaw),
        )

    def distance(self, other: "Pose") -> float:
        """Returns the straight distance [m] between the two positions."""
        return math.hypot(self.x - other.x, self.y - other.y)

    def between(self, other: "Pose", part: float) -> "Pose":
        """Returns the pose ``part`` (0 … 1) of the way to ``other``, turning the short way round."""
        turn = normalised(other.yaw - self.yaw)
        return Pose(
            self.x + part * (other.x - self.x), self.y + part * (other.y - self.y), normalised(self.yaw + part * turn)
        )


def normalised(angle: float) -> float:
    """Returns ``angle`` [rad] in [-pi, pi]."""
    return math.remainder(angle, math.tau)


def yaw_from_quaternion(x: float, y: float, z: float, w: float) -> float:
    """Returns the heading [rad] of a rotation given as a unit quaternion."""
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def length(points: Points) -> float:
    """Returns the length [m] of a line through ``points``."""
    return sum(math.dist(start, end) for start, end in itertools.pairwise(points))


def remaining_length(points: Points, position: tuple[float, float]) -> float:
    """Returns the length [m] of the line through ``points`` from the point nearest to ``position`` to its end."""
    if not points:
        return 0.0
    nearest = min(range(len(points)), key=lambda index: math.dist(points[index], position))
    return math.dist(points[nearest], position) + length(points[nearest:])
