"""The last pose on the parameter server, from which a restarted amcl goes on."""

import xmlrpc.client

import rosgraph
import rospy

from nav_bundle.core.particle import Estimate


class PoseStore:
    """Writes an estimate into the node's ``~initial_pose_*`` and ``~initial_cov_*``.

    Args:
        rate: greatest rate [Hz] of writing; nothing is written at 0 or below.
    """

    def __init__(self, rate: float) -> None:
        self._period = 1.0 / rate if rate > 0.0 else 0.0
        self._next = 0.0
        self._saved: Estimate | None = None

    def save(self, estimate: Estimate, now: float) -> None:
        """Writes ``estimate`` if it is new and the last one is old enough at ROS time ``now`` [s]."""
        if self._period == 0.0 or now < self._next or estimate is self._saved:
            return
        self._next, self._saved = now + self._period, estimate
        pose, covariance = estimate.pose, estimate.covariance
        # One request for all: six would cost more than localisation itself.
        calls = xmlrpc.client.MultiCall(xmlrpc.client.ServerProxy(rosgraph.get_master_uri()))
        for name, value in (("pose_x", pose.x), ("pose_y", pose.y), ("pose_a", pose.yaw)):
            calls.setParam(rospy.get_name(), rospy.resolve_name(f"~initial_{name}"), value)
        for index, name in enumerate(("cov_xx", "cov_yy", "cov_aa")):
            calls.setParam(rospy.get_name(), rospy.resolve_name(f"~initial_{name}"), float(covariance[index, index]))
        try:
            calls()
        except (OSError, xmlrpc.client.Error) as error:
            rospy.logwarn_throttle(30, "cannot save the pose on the parameter server: %s", error)

    def restart(self) -> None:
        """Forgets when it last wrote: time jumped back."""
        self._next = 0.0
