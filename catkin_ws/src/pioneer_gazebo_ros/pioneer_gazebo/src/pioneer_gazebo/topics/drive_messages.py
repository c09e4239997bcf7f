"""Converts odometry to messages."""

from collections.abc import Sequence

import numpy as np
from nav_msgs.msg import Odometry as OdometryMessage

from pioneer_gazebo.physics.engine import Velocity
from pioneer_gazebo.ros.messages import POSE, TWIST, Stamped
from pioneer_gazebo.world.pose import Pose


class OdometryTemplate(Stamped):
    """nav_msgs/Odometry with constant covariances."""

    def __init__(
        self, frame: str, child_frame: str, pose: Sequence[float], twist: Sequence[float]
    ) -> None:
        """Takes frame ids and the six diagonal values of each covariance."""
        message = OdometryMessage()
        message.header.frame_id, message.child_frame_id = frame, child_frame
        message.pose.covariance = np.diag(pose).ravel().tolist()
        message.twist.covariance = np.diag(twist).ravel().tolist()
        super().__init__(message)
        self._pose = self.body_start + 4 + len(child_frame.encode())
        self._twist = self._pose + POSE.size + 36 * 8

    def fill(self, time: int, pose: Pose, velocity: Velocity) -> bytearray:
        """Returns the frame for a time [ns], a pose and a velocity."""
        self.stamp(time)
        POSE.pack_into(self.frame, self._pose, *pose.position, *pose.rotation)
        TWIST.pack_into(self.frame, self._twist, *velocity.linear, *velocity.angular)
        return self.frame
