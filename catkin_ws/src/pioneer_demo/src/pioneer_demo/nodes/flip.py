"""Requests the flip rules through which the base station observes the robots' masters."""

import threading
from collections.abc import Sequence

import rospy
from gateway_msgs.msg import ConnectionType, ErrorCodes, RemoteRule, Rule
from gateway_msgs.srv import Remote, RemoteRequest

from pioneer_demo.core.command import gateway_name
from pioneer_demo.core.error import DemoError, FlipError

_SERVICE = "/gateway/flip"
_RETRY = 0.2
STATE = ("map_goal_client/queue",)
"""Topics of each robot that every fleet flips, in addition to /tf."""
COURSE = (*STATE, "move_base/NavfnROS/plan", "move_base/status")
"""Topics that a demo flips, for its picture and for reports about stuck robots."""
_NOT_YET = (ErrorCodes.NO_HUB_CONNECTION, ErrorCodes.HUB_CONNECTION_LOST, ErrorCodes.REMOTE_GATEWAY_NOT_VISIBLE)


class FlipRequest(threading.Thread):
    """Requests the observer's flips from the hub gateway, in its own thread: a service call cannot be interrupted.

    Subscriber flips, which bring the robots' publishers here, visible to ``node`` only: ``topics`` of each robot and
    the corrections on /tf. Publisher flip: the waypoints.
    """

    def __init__(self, node: str, robots: Sequence[str], topics: Sequence[str]) -> None:
        """Prepares the request of ``node`` (name without slash) for these robots."""
        super().__init__(name="flip request", daemon=True)
        self._rules = _rules(node, robots, topics)
        self._cancelled = threading.Event()
        self._accepted = False
        self._error: DemoError | None = None

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
        try:
            self._accepted = self._request()
        except FlipError as error:
            self._error = error

    def _request(self) -> bool:
        request = RemoteRequest(cancel=False, remotes=self._rules)
        call = rospy.ServiceProxy(_SERVICE, Remote)
        while not self._cancelled.is_set():
            try:
                answer = call(request)
            except (rospy.ServiceException, rospy.ROSException, OSError):
                answer = None  # the gateway is not up yet
            if answer is not None and answer.result == ErrorCodes.SUCCESS:
                return True
            if answer is not None and answer.result not in _NOT_YET:
                raise FlipError(
                    f"the hub gateway refused the observer's flips: {answer.error_message} ({answer.result})"
                )
            self._cancelled.wait(_RETRY)
        return False


def _rules(node: str, robots: Sequence[str], names: Sequence[str]) -> list[RemoteRule]:
    rules = []
    for number, robot in enumerate(robots, 1):
        topics = ["/tf", *(f"/{robot}/{topic}" for topic in names)]
        rules += [_rule(number, ConnectionType.SUBSCRIBER, topic, node) for topic in topics]
        rules.append(_rule(number, ConnectionType.PUBLISHER, f"/{robot}/map_goal", node))
    return rules


def _rule(number: int, kind: str, topic: str, node: str) -> RemoteRule:
    return RemoteRule(gateway_name(number), Rule(type=kind, name=topic, node=f"/{node}"))
