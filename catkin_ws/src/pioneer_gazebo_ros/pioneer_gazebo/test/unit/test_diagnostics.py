"""A simulation that runs slower than requested is a warning; a paused one is not."""

from diagnostic_msgs.msg import DiagnosticStatus

from pioneer_gazebo.node import judged


def test_only_a_running_simulation_can_be_too_slow() -> None:
    assert judged(0.5, 1.0, False) == (DiagnosticStatus.WARN, "slower than asked for: 0.50 of 1")
    assert judged(0.0, 1.0, True)[0] == DiagnosticStatus.OK
    assert judged(0.98, 1.0, False)[0] == DiagnosticStatus.OK
    assert judged(0.3, 0.0, False)[0] == DiagnosticStatus.OK
