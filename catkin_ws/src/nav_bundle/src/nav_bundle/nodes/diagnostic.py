"""amcl's status on /diagnostics."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from numpy.typing import NDArray


def deviation_status(
    node: str, covariance: NDArray[np.float64], limits: tuple[float, float, float]
) -> DiagnosticStatus:
    """Returns the status of an estimate: a warning if a standard deviation exceeds its limit.

    Args:
        node: amcl's node name.
        covariance: covariance over x [m], y [m], yaw [rad], shape (3, 3).
        limits: limits of the standard deviations of x [m], y [m], yaw [rad].
    """
    names, deviations = ("x", "y", "yaw"), np.sqrt(np.maximum(np.diag(covariance), 0.0))
    is_unsure = bool((deviations > limits).any())
    values = [KeyValue(f"std_{name}", f"{value:g}") for name, value in zip(names, deviations, strict=True)]
    values += [KeyValue(f"std_warn_level_{name}", f"{value:g}") for name, value in zip(names, limits, strict=True)]
    level, text = (DiagnosticStatus.WARN, "Too large") if is_unsure else (DiagnosticStatus.OK, "OK")
    return DiagnosticStatus(level, f"{node}: Standard deviation", text, "None", values)
