"""Keeps why a robot is held in a parameter of its master, for the coordinator that follows one that has died."""

import queue
import threading
import xmlrpc.client

import rospy

PARAMETER = "traffic/held"
"""In the robot's namespace: why the robot stays until its next goal; empty if it does not."""


class KeptHold:
    """Reads the parameter once, and writes it in a thread of its own: a master that hangs delays no stop."""

    def __init__(self) -> None:
        self.reason = str(
            rospy.get_param(PARAMETER, "")
        )  #: why the robot is held; empty if it is not
        self._changes: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._write, name="kept hold", daemon=True).start()

    def keep(self, reason: str) -> None:
        """Keeps why the robot is held, "" for a robot that is not; costs nothing while that is unchanged."""
        if reason != self.reason:
            self.reason = reason
            self._changes.put(reason)

    def _write(self) -> None:
        while True:
            reason = self._changes.get()
            try:
                rospy.set_param(PARAMETER, reason)
            except (OSError, xmlrpc.client.Error, rospy.ROSException) as error:
                rospy.logwarn("%s is not kept: %s", PARAMETER, error)
