"""What amcl does with its estimate besides publishing it: the last pose as a parameter, and the status."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from numpy.typing import NDArray

from nav_bundle.localisation.particle_filter import Estimate
from pioneer_node.nodes.parameter_server import set_parameters


class PoseStore:
    """Writes an estimate into the node's ``~initial_pose_*`` and ``~initial_cov_*``, where a restarted amcl resumes.

    Args:
        rate: maximum write rate [Hz]; nothing is written at 0 or below.
    """

    def __init__(self, rate: float) -> None:
        self._period = 1.0 / rate if rate > 0.0 else 0.0
        self._next = 0.0
        self._saved: Estimate | None = None

    def save(self, estimate: Estimate, now: float) -> bool:
        """Writes ``estimate`` if it is new and a write is due at ROS time ``now`` [s]; returns whether it did."""
        if self._period == 0.0 or now < self._next or estimate is self._saved:
            return False
        self._next, self._saved = now + self._period, estimate
        pose, covariance = estimate.pose, estimate.covariance
        names = ("pose_x", "pose_y", "pose_a", "cov_xx", "cov_yy", "cov_aa")
        values = (
            pose.x,
            pose.y,
            pose.yaw,
            *(float(covariance[index, index]) for index in range(3)),
        )
        set_parameters(
            {f"~initial_{name}": value for name, value in zip(names, values, strict=True)}
        )
        return True

    def restart(self) -> None:
        """Resets the write timer after time jumped back."""
        self._next = 0.0


def deviation_status(
    node: str, covariance: NDArray[np.float64], limits: tuple[float, float, float]
) -> DiagnosticStatus:
    """Returns the status of an estimate for /diagnostics: a warning if a standard deviation exceeds its limit.

    Args:
        node: amcl's node name.
        covariance: covariance over x [m], y [m], yaw [rad], shape (3, 3).
        limits: limits of the standard deviations of x [m], y [m], yaw [rad].
    """
    names, deviations = ("x", "y", "yaw"), np.sqrt(np.maximum(np.diag(covariance), 0.0))
    is_unsure = bool((deviations > limits).any())
    values = [
        KeyValue(f"std_{name}", f"{value:g}") for name, value in zip(names, deviations, strict=True)
    ]
    values += [
        KeyValue(f"std_warn_level_{name}", f"{value:g}")
        for name, value in zip(names, limits, strict=True)
    ]
    level, text = (DiagnosticStatus.WARN, "Too large") if is_unsure else (DiagnosticStatus.OK, "OK")
    return DiagnosticStatus(level, f"{node}: Standard deviation", text, "None", values)
