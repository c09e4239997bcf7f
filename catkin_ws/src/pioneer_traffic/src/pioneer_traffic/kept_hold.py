"""Keeps why a robot is held in a parameter of its master, for the coordinator that follows one that has died."""

import http.client
import queue
import threading
import xmlrpc.client
from xml.parsers.expat import ExpatError

import rospy

from pioneer_node.nodes.standing_warning import StandingWarning

PARAMETER = "traffic/held"
"""In the robot's namespace: why the robot stays until its next goal; empty if it does not."""
RETRY = 1.0
"""Time after which a write that failed is tried again [s]."""
_FAILURES = (
    OSError,
    http.client.HTTPException,
    xmlrpc.client.Error,
    ExpatError,
    rospy.ROSException,
)
"""What a call raises if the master is away, or ends while it answers."""


class KeptHold:
    """Reads the parameter once, and writes it in a thread of its own: a master that hangs delays no stop.

    What cannot be written is tried again each `RETRY`, unless something newer is to be written.
    """

    def __init__(self) -> None:
        self.reason = str(
            rospy.get_param(PARAMETER, "")
        )  #: why the robot is held; empty if it is not
        self._changes: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._failing = StandingWarning(f"{PARAMETER} is kept again")
        threading.Thread(target=self._write, name="kept hold", daemon=True).start()

    def keep(self, reason: str) -> None:
        """Keeps why the robot is held, "" for a robot that is not; costs nothing while that is unchanged."""
        if reason != self.reason:
            self.reason = reason
            self._changes.put(reason)

    def _write(self) -> None:
        reason = self._changes.get()
        while True:
            is_written = self._has_written(reason)
            try:
                reason = self._changes.get(timeout=None if is_written else RETRY)
            except queue.Empty:
                continue

    def _has_written(self, reason: str) -> bool:
        try:
            rospy.set_param(PARAMETER, reason)
        except _FAILURES as error:
            self._failing.warn(f"{PARAMETER} is not kept: {error}")
            return False
        self._failing.end()
        return True
