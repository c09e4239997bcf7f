"""move_base's state for others: a latched topic, the log and /diagnostics, in the same words."""

import math

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point
from std_msgs.msg import Header

from nav_bundle.move_base.navigator import Report
from nav_bundle.move_base.reason import Condition
from nav_bundle.msg import NavigationState

_STATES = {
    Condition.STARTING: NavigationState.STARTING,
    Condition.IDLE: NavigationState.IDLE,
    Condition.DRIVING: NavigationState.DRIVING,
    Condition.RECOVERING: NavigationState.RECOVERING,
    Condition.BLOCKED: NavigationState.BLOCKED,
    Condition.WAITING: NavigationState.WAITING,
    Condition.LOST: NavigationState.LOST,
    Condition.HELD: NavigationState.HELD,
    Condition.MANUAL: NavigationState.MANUAL,
    Condition.FAILED: NavigationState.FAILED,
    Condition.OFFLINE: NavigationState.OFFLINE,
}
_TROUBLE = (Condition.BLOCKED, Condition.RECOVERING, Condition.FAILED, Condition.LOST)
_DIAGNOSTICS_PERIOD = 1.0
"""Time [s] between two messages on /diagnostics."""


def message_from_report(report: Report, frame: str, now: float) -> NavigationState:
    """Returns ``report`` as a message; places are in ``frame``."""
    reason = report.reason
    x, y = reason.place or (math.nan, math.nan)
    return NavigationState(
        header=Header(0, rospy.Time.from_sec(now), frame),
        state=_STATES[report.condition],
        reason=int(reason.code),
        has_place=reason.place is not None,
        place=Point(x, y, 0.0),
        robot=reason.robot,
        since=rospy.Time.from_sec(report.since),
        text=report.text(),
    )


def diagnostic_from_report(report: Report) -> DiagnosticStatus:
    """Returns ``report`` as a status for /diagnostics: a warning if the robot has a goal and does not get on."""
    level = DiagnosticStatus.WARN if report.condition in _TROUBLE else DiagnosticStatus.OK
    values = [KeyValue("reason", report.reason.code.name), KeyValue("since", f"{report.since:.1f}")]
    if report.reason.robot:
        values.append(KeyValue("robot", report.reason.robot))
    return DiagnosticStatus(
        level, rospy.get_name().lstrip("/"), report.text(), rospy.get_namespace(), values
    )


class StatePublisher:
    """Publishes what the robot is doing, and why it does not arrive.

    Publishes: ``~state`` (nav_bundle/NavigationState, latched, at each change), ``/diagnostics``
        (diagnostic_msgs/DiagnosticArray, once per second).

    Args:
        frame: the global costmap's frame.
    """

    def __init__(self, frame: str) -> None:
        self._frame = frame
        self._publisher = rospy.Publisher("~state", NavigationState, queue_size=1, latch=True)
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=2)
        self._diagnosed = -math.inf
        self._report: Report | None = None

    def show(self, report: Report, now: float) -> None:
        """Publishes ``report``, if it has changed; logs trouble."""
        if report is not self._report:
            self._report = report
            self._publisher.publish(message_from_report(report, self._frame, now))
            if report.condition is Condition.BLOCKED:
                rospy.logwarn("%s", report.text())
        if not 0.0 <= now - self._diagnosed < _DIAGNOSTICS_PERIOD:
            self._diagnosed = now
            header = Header(0, rospy.Time.from_sec(now), "")
            self._diagnostics.publish(DiagnosticArray(header, [diagnostic_from_report(report)]))
