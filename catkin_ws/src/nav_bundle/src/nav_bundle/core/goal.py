"""Validation of goals for planar navigation."""

import math

from nav_bundle.core.error import NavigationError

_VERTICAL = 1.0e-3
Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""


class GoalError(NavigationError):
    """A goal that is invalid on any map; the message names the reason."""


def check_goal(position: tuple[float, float, float], rotation: Quaternion) -> None:
    """Raises if a goal has a NaN or infinite number, or a rotation that is not a pure yaw.

    Raises:
        GoalError: with move_base's message.
    """
    if not all(math.isfinite(value) for value in rotation):
        raise GoalError("Quaternion has nans or infs... discarding as a navigation goal")
    if not all(math.isfinite(value) for value in position):
        raise GoalError("Position has nans or infs... discarding as a navigation goal")
    x, y, z, w = rotation
    squared = x * x + y * y + z * z + w * w
    if squared < 1.0e-6:
        raise GoalError("Quaternion has length close to zero... discarding as navigation goal")
    upright = (w * w - x * x - y * y + z * z) / squared
    if abs(upright - 1.0) > _VERTICAL:
        raise GoalError(
            "Quaternion is invalid... for navigation the z-axis of the quaternion must be close to vertical."
        )
