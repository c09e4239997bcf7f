"""Oscillation suppression: after a reversal, the old direction is blocked until the robot has moved on."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nav_bundle.core.local_planner import Velocity
from nav_bundle.core.pose import Pose, angle_difference


@dataclass
class _Direction:
    """One axis of the velocity: the sign of the last motion, and the only sign allowed (0 for both)."""

    last: int = 0
    only: int = 0

    def note(self, value: float) -> bool:
        """Records a chosen velocity; returns whether it reversed the last motion."""
        sign = (value > 0.0) - (value < 0.0)
        reversed_ = sign != 0 and self.last == -sign
        if reversed_:
            self.only = sign
        if sign != 0:
            self.last = sign
        return reversed_


@dataclass
class Oscillation:
    """dwa_local_planner's oscillation critic.

    Sideways motion and turns count only while the forward speed is at most ``slow`` [m/s]. A blocked direction is
    released once the robot is ``distance`` [m] or ``angle`` [rad] away from the pose where it reversed.
    """

    slow: float
    distance: float
    angle: float
    _axes: tuple[_Direction, ...] = field(default_factory=lambda: tuple(_Direction() for _ in range(3)))
    _since: Pose = field(default_factory=Pose)

    def reset(self) -> None:
        """Releases all directions and forgets the last motion."""
        self._axes = tuple(_Direction() for _ in range(3))

    def allowed(self, samples: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns a mask of the ``samples`` (n, 3) that do not move in a blocked direction."""
        only = np.array([axis.only for axis in self._axes])
        closed: NDArray[np.bool_] = (samples * only < 0.0).any(axis=1)
        return ~closed

    def note(self, chosen: Velocity, pose: Pose) -> None:
        """Records the velocity chosen at ``pose``."""
        forward, sideways, turning = self._axes
        is_reversal = forward.note(chosen.x)
        if abs(chosen.x) <= self.slow:
            is_reversal = sideways.note(chosen.y) or is_reversal
            is_reversal = turning.note(chosen.turn) or is_reversal
        if is_reversal:
            self._since = pose
        turned = abs(angle_difference(pose.yaw, self._since.yaw))
        has_moved = pose.distance(self._since) > self.distance or turned > self.angle
        if has_moved and any(axis.only for axis in self._axes):
            self.reset()
