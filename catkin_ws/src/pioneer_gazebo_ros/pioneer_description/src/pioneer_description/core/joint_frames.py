"""Where the frames of a robot's links are, and when that is due to be published."""

import math
from collections.abc import Iterable, Sequence

from pioneer_gazebo.core.joint import FIXED, FLOATING, PRISMATIC, Joint
from pioneer_gazebo.core.pose import Pose, Vector


class JointFrames:
    """The child frames of a robot's joints, each in its parent's, as robot_state_publisher publishes them.

    Args:
        joints: the robot's.
        period: between two messages about a joint, at least [ns].
    """

    def __init__(self, joints: Iterable[Joint], period: int) -> None:
        joints = tuple(joints)
        self.fixed = tuple(joint for joint in joints if joint.kind == FIXED)  #: joints that do not move
        #: joints that a position moves, by name
        self.moving = {joint.name: joint for joint in joints if joint.kind not in (FIXED, FLOATING)}
        self._period = period
        self._published: dict[str, int] = {}

    def due(self, time: int, names: Sequence[str]) -> tuple[str, ...]:
        """Returns the joints to publish of those in a message of this time [ns]; takes note that they are.

        All or none: they are due where it is time for one of them, or its time has gone back, as when a simulation is
        reset.
        """
        known = [name for name in names if name in self.moving]
        if not any(self._is_due(time, self._published.get(name)) for name in known):
            return ()
        self._published.update(dict.fromkeys(known, time))
        return tuple(known)

    def pose(self, name: str, position: float) -> Pose:
        """Returns the child's frame in the parent's where a moving joint is at a position [rad or m]."""
        joint = self.moving[name]
        return joint.pose.compose(_moved(joint, position))

    def _is_due(self, time: int, last: int | None) -> bool:
        return last is None or time >= last + self._period or time < last


def _moved(joint: Joint, position: float) -> Pose:
    if joint.kind == PRISMATIC:
        return Pose(_scaled(joint.axis, position))
    x, y, z = _scaled(joint.axis, math.sin(position / 2))
    return Pose(rotation=(x, y, z, math.cos(position / 2)))


def _scaled(vector: Vector, factor: float) -> Vector:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor
