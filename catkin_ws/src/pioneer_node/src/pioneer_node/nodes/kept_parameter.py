"""Keeps what a node must not forget in a parameter of its master, for the node that follows one that has died."""

import http.client
import queue
import threading
import xmlrpc.client
from typing import Any
from xml.parsers.expat import ExpatError

import rospy

from pioneer_node.nodes.standing_warning import StandingWarning

RETRY = 1.0
"""Time after which a write that failed is tried again [s]."""
CHECK = 5.0
"""Period of looking whether the master still has the value: a restarted one has lost it [s]."""
_FAILURES = (
    OSError,
    http.client.HTTPException,
    xmlrpc.client.Error,
    ExpatError,
    rospy.ROSException,
)
"""What a call raises if the master is away, or ends while it answers."""


class KeptParameter:
    """Reads a parameter once, and writes it in a thread of its own: a master that hangs delays nothing else.

    What cannot be written is tried again each `RETRY`, unless something newer is to be written. A value that is not
    empty is looked up each `CHECK`, and written again at a master that has lost it.

    Args:
        name: the parameter's name.
        empty: its value where there is nothing to keep.
    """

    def __init__(self, name: str, empty: Any) -> None:
        self.value: Any = rospy.get_param(name, empty)  #: what is kept
        self._name, self._empty = name, empty
        self._changes: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._failing = StandingWarning(f"{name} is kept again")
        threading.Thread(
            target=self._write, args=(self.value,), name=f"kept {name}", daemon=True
        ).start()

    def keep(self, value: Any) -> None:
        """Keeps a value; costs nothing while it is unchanged."""
        if value != self.value:
            self.value = value
            self._changes.put(value)

    def _write(self, value: Any) -> None:
        is_kept = True
        while True:
            nothing_to_do = is_kept and value == self._empty
            wait = None if nothing_to_do else (CHECK if is_kept else RETRY)
            try:
                value = self._changes.get(timeout=wait)
            except queue.Empty:
                is_kept = is_kept and self._is_known(value)
            else:
                is_kept = False
            is_kept = is_kept or self._has_written(value)

    def _is_known(self, value: Any) -> bool:
        """Returns whether the master has the value; also if it does not answer, which is no reason to write."""
        try:
            return bool(rospy.get_param(self._name, self._empty) == value)
        except _FAILURES:
            return True

    def _has_written(self, value: Any) -> bool:
        try:
            rospy.set_param(self._name, value)
        except _FAILURES as error:
            self._failing.warn(f"{self._name} is not kept: {error}")
            return False
        self._failing.end()
        return True
