"""A node's part in lockstep with the simulator: a member of a ring (docs/lockstep.md)."""

import os
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import rospy
from pioneer_msgs.msg import LockstepToken

from pioneer_node.nodes import entry
from pioneer_node.nodes.exchange import Exchange, set_time

INLET, OUTLET, PROBE = "period", "done", "probe"
RINGS, WITHHELD = "/lockstep/rings", "/lockstep/withheld"
"""What a member tells the simulator: who takes part, and what tokens are not to carry."""
_LOOK_EVERY = 0.5
"""How often a member looks whether its work has failed [s of wall time]."""
_CONNECT_WITHIN = 2.0
"""How long an inlet may be without connection until it is subscribed again [s of wall time]."""


def ring_topic(ring: str, name: str) -> str:
    """Returns a topic of a ring, whose name is its namespace; empty for the root."""
    return f"/{ring}/lockstep/{name}" if ring else f"/lockstep/{name}"


def ring_node(ring: str, name: str) -> str:
    """Returns the whole name of a ring's member."""
    return f"/{ring}/{name}" if ring else f"/{name}"


def ring_publisher(topic: str, latch: bool = False) -> rospy.Publisher:
    """Returns a publisher of tokens that writes in the caller's thread: a queue would cost a thread's wake-up."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SyntaxWarning)
        return rospy.topics.Publisher(topic, LockstepToken, latch=latch)


def ring_subscriber(topic: str, callback: Callable[[LockstepToken], None]) -> rospy.Subscriber:
    """Returns a subscriber of tokens."""
    return rospy.topics.Subscriber(topic, LockstepToken, callback, tcp_nodelay=True)


class Link:
    """A subscription of tokens that is made again until it has a publisher: rospy tries each publisher only once."""

    def __init__(self, topic: str, callback: Callable[[LockstepToken], None]) -> None:
        self._topic, self._callback = topic, callback
        self._subscriber, self._connected_at = ring_subscriber(topic, callback), time.monotonic()

    def keep_connected(self) -> None:
        """Subscribes again where there has been no connection for some time."""
        if self._subscriber.get_num_connections():
            self._connected_at = time.monotonic()
        elif time.monotonic() - self._connected_at > _CONNECT_WITHIN:
            self._subscriber.unregister()
            self._subscriber, self._connected_at = ring_subscriber(self._topic, self._callback), time.monotonic()


class Member:
    """One member of a ring.

    Subscribes: ``lockstep/period``, or ``lockstep/after_NAME`` of the member before it (pioneer_msgs/LockstepToken),
        ``lockstep/probe``.

    Publishes: ``lockstep/done``, or ``lockstep/after_NAME`` for the member behind it.

    Threads: the period's work is done in rospy's thread of the inlet; each call has returned before the next begins.

    On error: what the work raises ends `spin`; the ring stands still then, and the simulator reports this member.
    """

    def __init__(self, ring: str, members: Sequence[str], name: str) -> None:
        """Takes the ring's name, its members in the order in which they act, and this one's name among them."""
        self.exchange = Exchange(rospy.get_name())
        self.exchange.partners = tuple(ring_node(ring, one) for one in members)
        self._place = list(members).index(name)
        inlet = INLET if self._place == 0 else f"after_{members[self._place - 1]}"
        outlet = OUTLET if self._place == len(members) - 1 else f"after_{name}"
        self._inlet, self._probe = ring_topic(ring, inlet), ring_topic(ring, PROBE)
        self._outlet = ring_publisher(ring_topic(ring, outlet))
        self._answers = self._outlet if outlet == OUTLET else ring_publisher(ring_topic(ring, OUTLET))
        self._links: list[Link] = []
        self._failed: Exception | None = None
        self._working = threading.Event()
        self._period = -1  # until it has joined
        self._last: LockstepToken | None = None
        self._step: Callable[[], None] = lambda: None
        self._ready: Callable[[], bool] = lambda: True

    def start(self, step: Callable[[], None], ready: Callable[[], bool] = lambda: True) -> None:
        """Begins to take tokens; what the node subscribes to must be subscribed by now.

        Args:
            step: does one period's work; its messages have been delivered and ROS time is the period's end.
            ready: returns whether the node has what it needs before the first period; any thread asks.
        """
        self._step, self._ready = step, ready
        self._links = [Link(self._inlet, self._take), Link(self._probe, self._answer)]

    def spin(self, step: Callable[[], None], ready: Callable[[], bool] = lambda: True) -> None:
        """Does what `start` does, and returns at shutdown.

        Raises:
            Exception: what ``step``, or a subscriber's callback, raised.
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
            if token.kind == LockstepToken.JOIN:
                self._join(token)
            elif self._last is not None and token.period == self._last.period:
                self._outlet.publish(self._last)  # sent again because it was lost, here or behind
            elif token.period > self._period >= 0:
                self._work(token)
        except Exception as error:  # noqa: BLE001 - the loop of this node: ``spin`` raises it
            self._failed = error

    def _join(self, token: LockstepToken) -> None:
        if token.period < self._period or not self._ready():
            return  # the simulator asks again
        self._period, self._last = token.period, None
        set_time(token.stamp)
        token.members.append(self.exchange.name)
        token.wants = sorted({*token.wants, *self.exchange.topics()})
        self._outlet.publish(token)

    def _work(self, token: LockstepToken) -> None:
        self._working.set()
        self._period = token.period
        exchange = self.exchange
        set_time(token.stamp)
        if token.members:
            exchange.partners = tuple(token.members)
            exchange.set_wanted(token.wants)
        exchange.deliver(token.messages)
        exchange.run_timers()
        self._step()
        token.messages = [one for one in token.messages if one.sender != exchange.name] + exchange.take()
        self._working.clear()
        self._last = token
        self._outlet.publish(token)

    def _answer(self, probe: LockstepToken) -> None:
        kind = LockstepToken.WORKING if self._working.is_set() else LockstepToken.FINISHED
        self._answers.publish(LockstepToken(kind, max(self._period, 0), probe.stamp, [self.exchange.name], [], []))


class Turns:
    """A node whose work is done in its member's periods, for `entry.run`."""

    def __init__(self, member: Member, node: Any) -> None:
        self._member, self._node = member, node

    def spin(self) -> None:
        """Works until shutdown."""
        self._member.spin(getattr(self._node, "step", lambda: None), getattr(self._node, "ready", lambda: True))


def joined() -> Member | None:
    """Returns this node's membership where its launch file makes it a member (`entry.MEMBERS`), else None.

    To be called once, after ``rospy.init_node`` and before the node has publishers and subscribers.
    """
    members = os.environ.get(entry.MEMBERS, "").split()
    ring = rospy.get_namespace().strip("/")
    name = rospy.get_name().strip("/").removeprefix(ring).strip("/")
    if name not in members:
        return None
    member = Member(ring, members, name)
    member.exchange.install()
    return member
