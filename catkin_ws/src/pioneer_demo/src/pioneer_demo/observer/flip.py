"""Requests the flip rules through which the base station observes the robots' masters."""

import contextlib
import threading
from collections.abc import Sequence

import rospy
from gateway_msgs.msg import ConnectionType, ErrorCodes, RemoteRule, Rule
from gateway_msgs.srv import Remote, RemoteRequest

from pioneer_demo.error import FlipError
from pioneer_demo.processes.command import gateway_name

_SERVICE = "/gateway/flip"
_RETRY = 0.2
STATE = ("map_goal_client/queue", "move_base/state")
"""Topics of each robot that every fleet flips, in addition to /tf."""
TRAFFIC = ("traffic/state",)
"""Topics that a fleet with right of way flips as well."""
COURSE = (*STATE, "move_base/NavfnROS/plan", "move_base/status")
"""Topics that a demo flips, for its picture and for reports about stuck robots."""
_NOT_YET = (
    ErrorCodes.NO_HUB_CONNECTION,
    ErrorCodes.HUB_CONNECTION_LOST,
    ErrorCodes.REMOTE_GATEWAY_NOT_VISIBLE,
)


class FlipRequest(threading.Thread):
    """Requests the observer's flips from the hub gateway, in its own thread: a service call cannot be interrupted.

    Subscriber flips, which bring the robots' publishers here, visible to ``node`` only: ``topics`` of each robot and
    the corrections on /tf. Publisher flip: the waypoints.
    """

    def __init__(self, node: str, robots: Sequence[str], topics: Sequence[str]) -> None:
        """Prepares the request of ``node`` (name without slash) for these robots."""
        super().__init__(name="flip request", daemon=True)
        self._request = RemoteRequest(cancel=False, remotes=_rules(node, robots, topics))
        self._cancelled = threading.Event()
        self._accepted = False
        self._error: FlipError | None = None

    def cancel(self) -> None:
        """Asks the thread to end soon."""
        self._cancelled.set()

    def accepted(self) -> bool:
        """Returns whether the gateway has accepted the rules.

        Raises:
            FlipError: the gateway has refused them.
        """
        if self._error is not None:
            raise self._error
        return self._accepted

    def run(self) -> None:
        """Calls the service until it accepts or refuses, or ``cancel`` is called."""
        call = rospy.ServiceProxy(_SERVICE, Remote)
        while not (self._cancelled.is_set() or self._accepted or self._error):
            # The gateway may not be up yet.
            with contextlib.suppress(rospy.ServiceException, rospy.ROSException, OSError):
                answer = call(self._request)
                self._accepted = answer.result == ErrorCodes.SUCCESS
                if not self._accepted and answer.result not in _NOT_YET:
                    reason = f"{answer.error_message} ({answer.result})"
                    self._error = FlipError(
                        f"the hub gateway refused the observer's flips: {reason}"
                    )
            if not self._accepted:
                self._cancelled.wait(_RETRY)


def _rules(node: str, robots: Sequence[str], names: Sequence[str]) -> list[RemoteRule]:
    rules = []
    for number, robot in enumerate(robots, 1):
        topics = [
            (ConnectionType.SUBSCRIBER, topic)
            for topic in ("/tf", *(f"/{robot}/{name}" for name in names))
        ]
        for kind, topic in (*topics, (ConnectionType.PUBLISHER, f"/{robot}/map_goal")):
            rules.append(
                RemoteRule(gateway_name(number), Rule(type=kind, name=topic, node=f"/{node}"))
            )
    return rules
