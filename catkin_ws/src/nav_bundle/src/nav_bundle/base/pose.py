"""Poses in the plane and angles."""

import math
from dataclasses import dataclass
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

LARGEST = 1.0e8
"""Largest magnitude of a coordinate [m]: map projections such as UTM stay below it, and grids can index it."""

Coordinate = TypeVar("Coordinate", float, NDArray[np.float64])


def normalized_angle(angle: float) -> float:
    """Returns ``angle`` [rad] normalised to [-pi, pi]."""
    return math.remainder(angle, math.tau)


def angle_difference(first: float, second: float) -> float:
    """Returns the shortest turn [rad], in [-pi, pi], from angle ``second`` to angle ``first``."""
    return math.remainder(first - second, math.tau)


@dataclass(frozen=True, slots=True)
class Pose:
    """A planar pose, equivalent to the transform ``parent_from_child``."""

    x: float = 0.0  #: position [m] in the parent frame
    y: float = 0.0  #: position [m] in the parent frame
    yaw: float = 0.0  #: heading [rad], counter-clockwise from the parent's x axis; not necessarily normalised

    def compose(self, other: Self) -> "Pose":
        """Returns ``other``, a pose in this pose's frame, in the parent frame; yaw in [-pi, pi]."""
        x, y = self.apply(other.x, other.y)
        return Pose(x, y, normalized_angle(self.yaw + other.yaw))

    def inverse(self) -> "Pose":
        """Returns the pose of the parent frame in this pose's frame."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return Pose(
            -self.x * cosine - self.y * sine,
            self.x * sine - self.y * cosine,
            normalized_angle(-self.yaw),
        )

    def apply(self, x: Coordinate, y: Coordinate) -> tuple[Coordinate, Coordinate]:
        """Transforms point (``x``, ``y``) [m], or arrays of them, from this pose's frame to the parent frame."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return self.x + cosine * x - sine * y, self.y + sine * x + cosine * y

    def distance(self, other: Self) -> float:
        """Returns the Euclidean distance [m] to ``other``, ignoring yaw."""
        return math.hypot(self.x - other.x, self.y - other.y)
