"""Computes the frames of a robot's links and when to publish them."""

import math
from collections.abc import Iterable, Sequence

from pioneer_gazebo.world.joint import FIXED, FLOATING, PRISMATIC, Joint
from pioneer_gazebo.world.pose import Pose, Vector


class JointFrames:
    """The child frame of each joint in its parent's frame, as published by robot_state_publisher.

    Args:
        joints: the robot's joints.
        period: minimum time between two messages about a joint [ns].
    """

    def __init__(self, joints: Iterable[Joint], period: int) -> None:
        joints = tuple(joints)
        self.fixed = tuple(joint for joint in joints if joint.kind == FIXED)  #: fixed joints
        #: joints moved by a joint position, by name
        self.moving = {joint.name: joint for joint in joints if joint.kind not in (FIXED, FLOATING)}
        self._period = period
        self._published: dict[str, int] = {}

    def due(self, time: int, names: Sequence[str]) -> tuple[str, ...]:
        """Returns the joints of a message with this time stamp [ns] that are due, and marks them as published.

        Returns all of the message's joints or none: they are due if the period of one has elapsed, or if time has
        jumped back, as after a simulation reset.
        """
        known = [name for name in names if name in self.moving]
        if all(0 <= time - self._published.get(name, -math.inf) < self._period for name in known):
            return ()
        self._published.update(dict.fromkeys(known, time))
        return tuple(known)

    def pose(self, name: str, position: float) -> Pose:
        """Returns the child frame in the parent frame for a joint position [rad or m]."""
        joint = self.moving[name]
        if joint.kind == PRISMATIC:
            return joint.pose.compose(Pose(_scaled(joint.axis, position)))
        rotation = (*_scaled(joint.axis, math.sin(position / 2)), math.cos(position / 2))
        return joint.pose.compose(Pose(rotation=rotation))


def _scaled(vector: Vector, factor: float) -> Vector:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor
