"""Publishes the simulator's state on ``/diagnostics``."""

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from pioneer_gazebo.nodes.topic import publish_while_alive

SLOW = 0.9
"""Below this fraction of the requested real-time factor, the status is a warning."""


class Diagnostics:
    """Publishes ``/diagnostics`` (diagnostic_msgs/DiagnosticArray): one status, named after the node."""

    def __init__(self) -> None:
        self._publisher = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=1)

    def publish(self, simulated: float, measured: float, asked: float, paused: bool, models: int, robots: int) -> None:
        """Publishes one status; does nothing without subscribers.

        Args:
            simulated: simulated time [s].
            measured: real-time factor of the last second.
            asked: requested real-time factor; 0: as fast as possible.
            paused: whether the simulation is paused.
            models: number of all models.
            robots: number of robots.
        """
        if not self._publisher.get_num_connections():
            return
        level, message = judged(measured, asked, paused)
        values = {
            "simulated time [s]": f"{simulated:.3f}",
            "real-time factor": f"{measured:.3f}",
            "real-time factor asked for": f"{asked:g}",
            "models": str(models),
            "robots": str(robots),
        }
        status = DiagnosticStatus(level, f"{rospy.get_name()[1:]}: simulation", message, "pioneer_gazebo", [])
        status.values = [KeyValue(key, value) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        whole, rest = divmod(simulated, 1.0)
        array.header.stamp = rospy.Time(int(whole), int(rest * 1e9))
        publish_while_alive(self._publisher, array)


def judged(measured: float, asked: float, paused: bool) -> tuple[int, str]:
    """Returns level and message for a real-time factor; see `Diagnostics.publish`."""
    if paused:
        return DiagnosticStatus.OK, "paused"
    if asked > 0 and measured < SLOW * asked:
        return DiagnosticStatus.WARN, f"slower than asked for: {measured:.2f} of {asked:g}"
    return DiagnosticStatus.OK, "running"
