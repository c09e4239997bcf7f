"""Conversions of amcl's particles and covariances."""

import io
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from numpy.typing import NDArray
from std_msgs.msg import Header

from nav_bundle.base.conversions import check_numbers, pose_fields, write_at_end
from nav_bundle.base.pose import LARGEST
from pioneer_node.core.frame import stripped


class ParticlesMessage(PoseArray):  # type: ignore[misc]
    """A PoseArray serialised from a numpy array. For publishers."""

    def __init__(self, particles: NDArray[np.float64], frame: str, stamp: Any) -> None:
        super().__init__(Header(0, stamp, stripped(frame)), [])
        self.particles = particles  #: x, y [m], yaw [rad], shape (n, 3)

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the particles as poses at z = 0."""
        super().serialize(buff)
        write_at_end(buff, pose_fields(self.particles))


def covariance_from_message(message: PoseWithCovarianceStamped) -> NDArray[np.float64]:
    """Returns the covariance over x [m], y [m], yaw [rad], shape (3, 3), of a pose with covariance.

    Raises:
        MessageError: a number is not finite, or exceeds ``LARGEST`` squared.
    """
    check_numbers("initial pose", message.pose, LARGEST**2)
    full = np.array(message.pose.covariance).reshape(6, 6)
    return full[np.ix_([0, 1, 5], [0, 1, 5])]


def covariance_message(covariance: NDArray[np.float64]) -> list[float]:
    """Returns a 6 x 6 covariance in row-major order from a covariance over x, y, yaw."""
    full = np.zeros((6, 6))
    full[np.ix_([0, 1, 5], [0, 1, 5])] = covariance
    return full.ravel().tolist()
