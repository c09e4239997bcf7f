"""Makes a rospy node a ring member that runs in lockstep with the simulator (docs/lockstep.md)."""

import os
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import rospy
from pioneer_msgs.msg import LockstepToken

from pioneer_node.adapters.exchange import Place
from pioneer_node.core.ring import membership
from pioneer_node.nodes import entry
from pioneer_node.nodes.exchange import Exchange, set_time

RINGS, WITHHELD = "/lockstep/rings", "/lockstep/withheld"
"""Topics to the simulator: the rings that take part, and the topics or rings whose messages tokens must not carry."""
_LOOK_EVERY = 0.5
"""Interval at which a member checks whether its work has failed [s of wall time]."""
_CONNECT_WITHIN = 2.0
"""Time without a connection after which a link subscribes again [s of wall time]."""


def ring_publisher(topic: str, latch: bool = False) -> rospy.Publisher:
    """Returns a token publisher that writes in the caller's thread: a queue would have to wake up another thread."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SyntaxWarning)
        return rospy.topics.Publisher(topic, LockstepToken, latch=latch)


def ring_subscriber(topic: str, callback: Callable[[LockstepToken], None]) -> rospy.Subscriber:
    """Returns a token subscriber."""
    return rospy.topics.Subscriber(topic, LockstepToken, callback, tcp_nodelay=True)


class Link:
    """A token subscription that is renewed until a publisher is connected: rospy tries each publisher only once."""

    def __init__(self, topic: str, callback: Callable[[LockstepToken], None]) -> None:
        self._topic, self._callback = topic, callback
        self._subscriber, self._connected_at = ring_subscriber(topic, callback), time.monotonic()

    def keep_connected(self) -> None:
        """Subscribes again if there has been no connection for `_CONNECT_WITHIN`."""
        if self._subscriber.get_num_connections():
            self._connected_at = time.monotonic()
        elif time.monotonic() - self._connected_at > _CONNECT_WITHIN:
            self._subscriber.unregister()
            self._subscriber, self._connected_at = (
                ring_subscriber(self._topic, self._callback),
                time.monotonic(),
            )


class Member:
    """One member of a ring.

    Subscribes: ``lockstep/period``, or ``lockstep/after_NAME`` of the previous member (pioneer_msgs/LockstepToken),
        ``lockstep/probe``.

    Publishes: ``lockstep/done``, or ``lockstep/after_NAME`` for the next member.

    Threads: the period's work runs in rospy's thread for the inlet.

    On error: an exception in the work ends `spin`; the ring then stops, and the simulator reports this member.
    """

    def __init__(self, ring: str, members: Sequence[str], name: str) -> None:
        """Takes the ring's name, its members in the order of their turns, and this member's name."""
        self.exchange = Exchange(rospy.get_name())
        self._place = place = Place(self.exchange, ring, members, name, set_time)
        self._outlet = ring_publisher(place.outlet)
        self._answers = (
            self._outlet if place.answers == place.outlet else ring_publisher(place.answers)
        )
        self._links: list[Link] = []
        self._failed: Exception | None = None

    def start(self, step: Callable[[], None], ready: Callable[[], bool] = lambda: True) -> None:
        """Starts to process tokens; call it after the node has created its subscribers.

        Args:
            step: does one period's work, after the period's messages are delivered and ROS time is set to its end.
            ready: returns whether the node is ready for its first period; called from any thread.
        """

        def work() -> None:
            self.exchange.run_timers()
            step()

        self._place.step, self._place.ready = work, ready
        self._links = [Link(self._place.inlet, self._take), Link(self._place.probe, self._answer)]

    def spin(self, step: Callable[[], None], ready: Callable[[], bool] = lambda: True) -> None:
        """Calls `start` and blocks until shutdown.

        Raises:
            Exception: whatever ``step`` or a subscriber's callback raised.
        """
        self.start(step, ready)
        while not entry.wait(_LOOK_EVERY):
            if self._failed is not None:
                raise self._failed
            for link in self._links:
                link.keep_connected()

    def _take(self, token: LockstepToken) -> None:
        if self._failed is not None:
            return
        try:
            passed_on = self._place.take(token)
        except Exception as error:  # noqa: BLE001 - the loop of this node: ``spin`` raises it
            self._failed = error
        else:
            if passed_on is not None:
                self._outlet.publish(passed_on)

    def _answer(self, probe: LockstepToken) -> None:
        self._answers.publish(self._place.answer(probe))


class Turns:
    """Wraps a node for `entry.run` so that its work runs in its ring member's periods."""

    def __init__(self, member: Member, node: Any) -> None:
        self._member, self._node = member, node

    def spin(self) -> None:
        """Runs until shutdown, or until the work fails; then calls the node's ``stop``."""
        step = getattr(self._node, "step", lambda: None)
        ready = getattr(self._node, "ready", lambda: True)
        stop = getattr(self._node, "stop", lambda: None)
        try:
            self._member.spin(step, ready)
        finally:
            stop()


def joined() -> Member | None:
    """Returns this node's `Member` if its launch file puts it in a ring (`core.ring.MEMBERS`), else None.

    Call it once, after ``rospy.init_node`` and before the node creates publishers and subscribers.
    """
    ring, members, name = membership(rospy.get_name(), rospy.get_namespace(), os.environ)
    if not members:
        return None
    member = Member(ring, members, name)
    member.exchange.install()
    return member
