"""Odometry motion models for particles (Thrun, Burgard and Fox, Probabilistic Robotics, 5.4).

As in ROS, the models without "-corrected" in their name use the variance as the standard deviation, so that the
noise becomes too small for small steps. Parameters tuned for one kind do not suit the other.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose, angle_difference

Alphas = tuple[float, float, float, float, float]
"""odom_alpha1 … 5: noise of rotation from rotation, rotation from translation, translation from translation,
translation from rotation; and (omni) strafing from translation."""

MotionModel = Callable[[NDArray[np.float64], Pose, Pose, np.random.Generator], None]
"""Moves particles (x, y [m], yaw [rad]; shape (n, 3)) in place, from one odometry pose to the next."""

Noise = Callable[..., NDArray[np.float64]]
"""Returns each particle's error, shape (3, n), from three variances."""

STANDSTILL = 0.01
"""A step shorter than this [m] counts as a turn in place, since its direction is undefined."""


def motion_model(name: str, alphas: Alphas) -> MotionModel:
    """Returns the model called ``name`` (see ``ODOM_MODELS``) with noise ``alphas``."""
    is_corrected = name.endswith("-corrected")
    step = _drive if name.startswith("diff") else _strafe

    def move(
        particles: NDArray[np.float64], before: Pose, after: Pose, generator: np.random.Generator
    ) -> None:
        def noise(*variances: float) -> NDArray[np.float64]:
            deviations = np.sqrt(variances) if is_corrected else np.array(variances)
            return generator.standard_normal((3, len(particles))) * deviations[:, None]

        step(particles, before, after, alphas, noise)

    return move


def _drive(
    particles: NDArray[np.float64], before: Pose, after: Pose, alphas: Alphas, noise: Noise
) -> None:
    """Moves particles as a differential drive: turn, drive straight, turn again."""
    distance = before.distance(after)
    turn = angle_difference(after.yaw, before.yaw)
    first = 0.0
    if distance >= STANDSTILL:
        first = angle_difference(math.atan2(after.y - before.y, after.x - before.x), before.yaw)
    second = angle_difference(turn, first)
    # Driving backwards is not a turn by pi, and has the same noise as driving forwards.
    first_noise, second_noise = (
        min(abs(a), abs(angle_difference(a, math.pi))) for a in (first, second)
    )
    a1, a2, a3, a4, _ = alphas
    error = noise(
        a1 * first_noise**2 + a2 * distance**2,
        a3 * distance**2 + a4 * (first_noise**2 + second_noise**2),
        a1 * second_noise**2 + a2 * distance**2,
    )
    heading = particles[:, 2] + first - error[0]
    length = distance - error[1]
    particles[:, 0] += length * np.cos(heading)
    particles[:, 1] += length * np.sin(heading)
    particles[:, 2] = heading + second - error[2]


def _strafe(
    particles: NDArray[np.float64], before: Pose, after: Pose, alphas: Alphas, noise: Noise
) -> None:
    """Moves particles as an omnidirectional base: translation in any direction with a simultaneous turn."""
    distance = before.distance(after)
    turn = angle_difference(after.yaw, before.yaw)
    a1, a2, a3, a4, a5 = alphas
    error = noise(
        a3 * distance**2 + a1 * turn**2,
        a4 * turn**2 + a2 * distance**2,
        a1 * turn**2 + a5 * distance**2,
    )
    bearing = particles[:, 2] + math.atan2(after.y - before.y, after.x - before.x) - before.yaw
    cosine, sine = np.cos(bearing), np.sin(bearing)
    length = distance + error[0]
    particles[:, 0] += length * cosine + error[2] * sine
    particles[:, 1] += length * sine - error[2] * cosine
    particles[:, 2] += turn + error[1]
