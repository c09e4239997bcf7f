"""Detects a robot that pushes against something: it stands despite a command, or its wheels slip.

Wheel slip shows when odometry advances but the laser scans show no motion.
"""

import numpy as np

from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.base.scan import Picture
from nav_bundle.base.velocity import Velocity

_WAY, _TURN = 0.15, 0.3
"""Odometry must advance by one of these [m], [rad] between two compared scans."""
_VISIBLE, _OCCLUDED = 0.05, 1.0
"""A beam is informative if its expected change is within these limits [m]; above, another object came into view."""
_BEAMS = 15
"""Minimum number of informative beams; fewer, as in a long corridor, give no result."""
_UNCHANGED, _MOST = 0.4, 0.7
"""A beam counts as unchanged below the first share of its expected change; the robot as stationary if more than the
second share of the beams is unchanged."""
_IN_A_ROW = 2
_COMMANDED, _STANDING = 0.05, 0.01
_MOVED, _TURNED = 0.03, 0.05
"""A robot whose odometry pose has changed by one of these [m], [rad] moves, whatever its odometry says of its speed."""


def stayed(before: Picture, after: Picture) -> bool | None:
    """Returns whether the laser did not move although odometry advanced; None if the scans do not allow a decision."""
    if min(len(before.points), len(after.points)) < _BEAMS:
        return None
    away = after.points - (after.sensor.x, after.sensor.y)
    bearings = np.arctan2(away[:, 1], away[:, 0]) - after.sensor.yaw
    seen, old = np.hypot(away[:, 0], away[:, 1]), before.ranges(bearings, before.sensor)
    change = np.abs(before.ranges(bearings, after.sensor) - old)
    telling = (change > _VISIBLE) & (change < _OCCLUDED)
    if np.count_nonzero(telling) < _BEAMS:
        return None
    return bool((np.abs(seen - old) < _UNCHANGED * change)[telling].mean() > _MOST)


class PushingWatch:
    """Monitors commands, odometry and scans; ``timeout`` [s] is how long the robot may stand despite a command."""

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self._since: float | None = None
        self._place = Pose()
        self._before: Picture | None = None
        self._slips = 0

    def reset(self) -> None:
        """Clears the history, for example after a manoeuvre."""
        self._since, self._before, self._slips = None, None, 0

    def note_motion(
        self, command: Velocity | None, measured: Velocity, pose: Pose, now: float
    ) -> None:
        """Records the last command, and the velocity and pose measured by odometry, which may have no velocity."""
        stands = abs(measured.x) < _STANDING and abs(measured.turn) < _STANDING
        moved = (
            pose.distance(self._place) > _MOVED
            or abs(angle_difference(pose.yaw, self._place.yaw)) > _TURNED
        )
        if command is None or abs(command.x) < _COMMANDED or not stands:
            self._since = None
        elif self._since is None or moved:
            self._since = now
            self._place = pose

    def note_picture(self, picture: Picture) -> None:
        """Compares a scan with an earlier one, once odometry has advanced far enough."""
        before = self._before
        if before is not None:
            turned = abs(angle_difference(picture.sensor.yaw, before.sensor.yaw))
            if picture.sensor.distance(before.sensor) < _WAY and turned < _TURN:
                return
            self._slips = self._slips + 1 if stayed(before, picture) else 0
        self._before = picture

    def pushes(self, now: float) -> bool:
        """Returns whether the robot pushes against something, or fails to move for another reason."""
        if self._timeout <= 0.0:
            return False
        stalls = self._since is not None and now - self._since > self._timeout
        return stalls or self._slips >= _IN_A_ROW
