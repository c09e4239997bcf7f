"""Velocities in the plane."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Velocity:
    """A velocity in the robot's frame: forward and left [m/s], counter-clockwise [rad/s]."""

    x: float = 0.0
    y: float = 0.0
    turn: float = 0.0


STANDSTILL = Velocity()
