"""A waypoint: position, heading and waiting time."""

import math
from dataclasses import dataclass


class WaypointError(ValueError):
    """An invalid waypoint: a number that is not finite, a negative wait, or an invalid orientation."""


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A planar pose in a named frame.

    Raises:
        WaypointError: a number is not finite, or the wait is negative.
    """

    x: float  #: position [m]
    y: float  #: position [m]
    yaw: float  #: heading [rad], counter-clockwise from the frame's x axis
    frame: str  #: name of the frame, without leading slash
    wait: float = 0.0  #: how long to stand there once it is reached [s]

    def __post_init__(self) -> None:
        for name in ("x", "y", "yaw", "wait"):
            if not math.isfinite(getattr(self, name)):
                raise WaypointError(f"{name} is {getattr(self, name)}, it must be finite")
        if self.wait < 0.0:
            raise WaypointError(f"wait is {self.wait}, it must not be negative")

    def __str__(self) -> str:
        return f"({self.x:.2f}, {self.y:.2f}, {math.degrees(self.yaw):.0f} deg) in {self.frame}"


def yaw_from_quaternion(x: float, y: float, z: float, w: float) -> float:
    """Returns the yaw [rad] in [-pi, pi] of a quaternion of any length; roll and pitch are dropped.

    Raises:
        WaypointError: the quaternion is zero or not finite, so it is not a rotation.
    """
    length = x * x + y * y + z * z + w * w
    if not math.isfinite(length) or length < 1e-12:
        raise WaypointError(f"orientation ({x}, {y}, {z}, {w}) is no rotation")
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
