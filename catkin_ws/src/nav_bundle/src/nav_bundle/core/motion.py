"""Odometry motion models for particles (Thrun, Burgard and Fox, Probabilistic Robotics, 5.4).

As in ROS, the models without "-corrected" in their name use the variance as the standard deviation, so that the
noise becomes too small for small steps. Parameters tuned for one kind do not suit the other.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core.pose import Pose, angle_difference

Alphas = tuple[float, float, float, float, float]
"""odom_alpha1 … 5: noise of rotation from rotation, rotation from translation, translation from translation,
translation from rotation; and (omni) strafing from translation."""

MotionModel = Callable[[NDArray[np.float64], Pose, Pose, np.random.Generator], None]
"""Moves particles (x, y [m], yaw [rad]; shape (n, 3)) in place, from one odometry pose to the next."""

STANDSTILL = 0.01
"""A step shorter than this [m] counts as a turn in place, since its direction is undefined."""


def motion_model(name: str, alphas: Alphas) -> MotionModel:
    """Returns the model called ``name`` (see ``ODOM_MODELS``) with noise ``alphas``."""
    corrected = name.endswith("-corrected")

    def deviation(variance: float) -> float:
        return math.sqrt(variance) if corrected else variance

    def move(particles: NDArray[np.float64], before: Pose, after: Pose, generator: np.random.Generator) -> None:
        step = _drive if name.startswith("diff") else _strafe
        step(particles, before, after, alphas, deviation, generator)

    return move


def _drive(
    particles: NDArray[np.float64],
    before: Pose,
    after: Pose,
    alphas: Alphas,
    deviation: Callable[[float], float],
    generator: np.random.Generator,
) -> None:
    """Moves particles as a differential drive: turn, drive straight, turn again."""
    distance = before.distance(after)
    turn = angle_difference(after.yaw, before.yaw)
    first = 0.0
    if distance >= STANDSTILL:
        first = angle_difference(math.atan2(after.y - before.y, after.x - before.x), before.yaw)
    second = angle_difference(turn, first)
    # Driving backwards is not a turn by pi, and has the same noise as driving forwards.
    first_noise, second_noise = (min(abs(a), abs(angle_difference(a, math.pi))) for a in (first, second))
    a1, a2, a3, a4, _ = alphas
    sigmas = (
        deviation(a1 * first_noise**2 + a2 * distance**2),
        deviation(a3 * distance**2 + a4 * (first_noise**2 + second_noise**2)),
        deviation(a1 * second_noise**2 + a2 * distance**2),
    )
    noise = generator.standard_normal((3, len(particles))) * np.array(sigmas)[:, None]
    heading = particles[:, 2] + first - noise[0]
    length = distance - noise[1]
    particles[:, 0] += length * np.cos(heading)
    particles[:, 1] += length * np.sin(heading)
    particles[:, 2] = heading + second - noise[2]


def _strafe(
    particles: NDArray[np.float64],
    before: Pose,
    after: Pose,
    alphas: Alphas,
    deviation: Callable[[float], float],
    generator: np.random.Generator,
) -> None:
    """Moves particles as an omnidirectional base: translation in any direction with a simultaneous turn."""
    distance = before.distance(after)
    turn = angle_difference(after.yaw, before.yaw)
    a1, a2, a3, a4, a5 = alphas
    sigmas = (
        deviation(a3 * distance**2 + a1 * turn**2),
        deviation(a4 * turn**2 + a2 * distance**2),
        deviation(a1 * turn**2 + a5 * distance**2),
    )
    noise = generator.standard_normal((3, len(particles))) * np.array(sigmas)[:, None]
    bearing = particles[:, 2] + math.atan2(after.y - before.y, after.x - before.x) - before.yaw
    cosine, sine = np.cos(bearing), np.sin(bearing)
    length = distance + noise[0]
    particles[:, 0] += length * cosine + noise[2] * sine
    particles[:, 1] += length * sine - noise[2] * cosine
    particles[:, 2] += turn + noise[1]
