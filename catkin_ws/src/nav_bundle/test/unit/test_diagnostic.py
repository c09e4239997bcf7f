"""amcl's status becomes a warning as soon as one of its standard deviations exceeds its limit."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from nav_bundle.localisation.topics import deviation_status


@pytest.mark.parametrize(
    ("deviations", "level"),
    [
        ((0.1, 0.1, 0.05), DiagnosticStatus.OK),
        ((0.3, 0.1, 0.05), DiagnosticStatus.WARN),
        ((0.1, 0.1, 0.2), DiagnosticStatus.WARN),
    ],
)
def test_an_estimate_too_uncertain_in_one_direction_is_a_warning(deviations, level):
    status = deviation_status("amcl", np.diag(np.square(deviations)), (0.2, 0.2, 0.1))
    assert status.level == level
    assert {value.key: float(value.value) for value in status.values}["std_x"] == pytest.approx(
        deviations[0]
    )
