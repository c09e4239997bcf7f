"""2D poses and lines."""

import bisect
import dataclasses
import itertools
import math
from collections.abc import Sequence

Points = list[tuple[float, float]]
"""Positions along a polyline [m]."""


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
        """Returns the Euclidean distance between the two positions [m]."""
        return math.hypot(self.x - other.x, self.y - other.y)

    def between(self, other: "Pose", part: float) -> "Pose":
        """Returns the interpolated pose at fraction ``part`` (0 … 1) towards ``other``, turning the shorter way."""
        turn = normalised(other.yaw - self.yaw)
        return Pose(
            self.x + part * (other.x - self.x),
            self.y + part * (other.y - self.y),
            normalised(self.yaw + part * turn),
        )


def pose_at(poses: Sequence[tuple[float, Pose]], time: float) -> Pose | None:
    """Returns the pose at ``time`` from poses in order of time, interpolated; None before the first, then the last."""
    after = bisect.bisect_right(poses, time, key=lambda one: one[0])
    if after in (0, len(poses)):
        return poses[-1][1] if after else None
    (begin, before), (end, following) = poses[after - 1], poses[after]
    return before.between(following, (time - begin) / (end - begin))


def normalised(angle: float) -> float:
    """Returns ``angle`` [rad] normalised to [-pi, pi]."""
    return math.remainder(angle, math.tau)


def yaw_from_quaternion(x: float, y: float, z: float, w: float) -> float:
    """Returns the yaw angle [rad] of a unit quaternion."""
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def length(points: Points) -> float:
    """Returns the length of the polyline through ``points`` [m]."""
    return sum(math.dist(start, end) for start, end in itertools.pairwise(points))


def remaining_length(points: Points, position: tuple[float, float]) -> float:
    """Returns the remaining length of a polyline [m]: from ``position`` to the nearest point, then to the end."""
    if not points:
        return 0.0
    nearest = min(range(len(points)), key=lambda index: math.dist(points[index], position))
    return math.dist(points[nearest], position) + length(points[nearest:])
