"""Message exchange of a lockstep node through tokens, and its handling of tokens (docs/lockstep.md)."""

import hashlib
import threading
from collections.abc import Callable, Collection, Hashable, Iterable, Sequence
from typing import Any

from pioneer_msgs.msg import LockstepMessage, LockstepToken

from pioneer_node.core.ring import INLET, OUTLET, PROBE, ring_topic

_STREAMS = {
    "sensor_msgs/LaserScan",
    "sensor_msgs/PointCloud2",
    "nav_msgs/Odometry",
    "rosgraph_msgs/Clock",
}
"""Types that a member accepts from tokens only: connections would deliver each message a second time."""

Take = Callable[[LockstepMessage], object]


def is_connected(kind: Any, topic: str) -> bool:
    """Returns whether a member also receives a topic over connections, from nodes outside the lockstep."""
    return kind._type not in _STREAMS and topic != "/tf"


class Exchange:
    """Holds one node's incoming and outgoing token messages. Other subscribers still get them over connections.

    Threads: ``deliver`` and ``take`` must be called from the thread that handles tokens; any thread may publish.
    """

    def __init__(self, name: str) -> None:
        self.name = name  #: this node's name
        self.partners: tuple[
            str, ...
        ] = ()  #: nodes in lockstep, including this one, whose messages come in tokens
        self.wanted: frozenset[str] = frozenset()  #: topics that any node in lockstep subscribes to
        self._listeners: dict[str, list[Take]] = {}
        self._latched: dict[tuple[str, Hashable], bytes] = {}
        self._sent: list[LockstepMessage] = []
        self._parts: dict[str, dict[bytes, bytes]] = {}
        self._heard: dict[tuple[str, str], bytes] = {}
        self._lock = threading.Lock()

    def topics(self) -> list[str]:
        """Returns the names of all topics this node subscribes to."""
        return sorted(self._listeners)

    def wants(self, topic: str) -> bool:
        """Returns whether any node in lockstep subscribes to a topic."""
        return topic in self.wanted

    def set_wanted(self, topics: Iterable[str]) -> None:
        """Sets the topics that any node in lockstep subscribes to; sends latched messages on newly added ones."""
        with self._lock:
            before, self.wanted = self.wanted, frozenset(topics)
            for (topic, _), data in self._latched.items():
                if topic in self.wanted and topic not in before:
                    self._sent.append(LockstepMessage(self.name, topic, data))

    def publish(self, topic: str, data: bytes, latched_by: Hashable = None) -> None:
        """Adds a serialised message to the next token if any node in lockstep subscribes to the topic.

        Args:
            topic: its name.
            data: the message.
            latched_by: the publisher if it latches; the message is then kept for subscribers that join later.
        """
        # Under one lock with `set_wanted`: a message of the moment in which a topic is taken up is sent exactly once.
        with self._lock:
            if latched_by is not None:
                self._latched[topic, latched_by] = data
            if topic in self.wanted:
                self._sent.append(LockstepMessage(self.name, topic, data))

    def forget(self, topic: str, publisher: Hashable) -> None:
        """Deletes the last message of a latching publisher that has ended."""
        with self._lock:
            self._latched.pop((topic, publisher), None)

    def listen(self, topic: str, take: Take) -> None:
        """Calls ``take`` for each token message of a topic."""
        self._listeners.setdefault(topic, []).append(take)

    def ignore(self, topic: str, take: Take) -> None:
        """Removes a callback added by `listen`."""
        self._listeners[topic].remove(take)
        if not self._listeners[topic]:
            del self._listeners[topic]

    def sample(self, topic: str, data: bytes, part: bytes = b"") -> None:
        """Stores a topic's newest message, or that of one ``part`` of it, for the next token; see `take`."""
        with self._lock:
            self._parts.setdefault(topic, {})[part] = data

    def take(self, join: Callable[[Collection[bytes]], bytes] = b"".join) -> list[LockstepMessage]:
        """Returns the messages since the last call: samples sorted by topic, then the others in publishing order.

        Args:
            join: combines a topic's parts into one message.
        """
        with self._lock:
            sent, self._sent = self._sent, []
            parts, self._parts = self._parts, {}
        sampled = [
            LockstepMessage(self.name, topic, found[b""] if b"" in found else join(found.values()))
            for topic, found in sorted(parts.items())
        ]
        return sampled + sent

    def deliver(self, messages: Iterable[LockstepMessage]) -> None:
        """Calls this node's subscribers in the order of the messages."""
        for message in messages:
            for take in tuple(self._listeners.get(message.topic, ())):
                take(message)

    def accepts(self, topic: str, sender: str, latched: bool, data: Callable[[], bytes]) -> bool:
        """Returns whether to accept a message received over a connection.

        Messages of partners come in tokens and are rejected here. So is a latched message repeated after a reconnect.

        Args:
            topic: its name.
            sender: the publisher's node; for a gateway's relay node, the remote node.
            latched: whether the publisher latches.
            data: returns the serialised message.
        """
        if sender in self.partners:
            return False
        if not latched:
            return True
        before, found = self._heard.get((topic, sender)), hashlib.sha256(data()).digest()
        self._heard[topic, sender] = found
        return before != found


class Place:
    """A member's place in its ring, which handles its tokens. Calls must not overlap.

    Args:
        exchange: the node's.
        ring: the ring's name.
        members: its members, in the order of their turns.
        name: this member's name.
        set_time: called with each token's time.
    """

    def __init__(
        self,
        exchange: Exchange,
        ring: str,
        members: Sequence[str],
        name: str,
        set_time: Callable[[Any], object],
    ) -> None:
        self.exchange = exchange
        exchange.partners = tuple(f"/{ring}/{one}" if ring else f"/{one}" for one in members)
        place = list(members).index(name)
        #: topics: tokens in, tokens out, probes in, probe answers out
        self.inlet = ring_topic(ring, INLET if place == 0 else f"after_{members[place - 1]}")
        self.outlet = ring_topic(ring, OUTLET if place == len(members) - 1 else f"after_{name}")
        self.probe, self.answers = ring_topic(ring, PROBE), ring_topic(ring, OUTLET)
        self.step: Callable[[], object] = lambda: None  #: called to do one period's work
        self.ready: Callable[[], bool] = lambda: (
            True
        )  #: returns whether the node is ready for its first period
        self._set_time = set_time
        self._working = threading.Event()
        self._period = -1  # not joined yet
        self._last: LockstepToken | None = None

    def take(self, token: LockstepToken) -> LockstepToken | None:
        """Processes a token; returns the token to pass on, if any."""
        if token.kind == LockstepToken.JOIN:
            return self._join(token)
        if self._last is not None and token.period == self._last.period:
            return self._last  # repeated because it was lost, here or further along the ring
        return self._work(token) if token.period > self._period >= 0 else None

    def _join(self, token: LockstepToken) -> LockstepToken | None:
        if token.period < self._period or not self.ready():
            return None  # the simulator asks again
        self._period, self._last = token.period, None
        self._set_time(token.stamp)
        token.members.append(self.exchange.name)
        token.wants = sorted({*token.wants, *self.exchange.topics()})
        return token

    def _work(self, token: LockstepToken) -> LockstepToken:
        self._working.set()
        self._period = token.period
        exchange = self.exchange
        self._set_time(token.stamp)
        if token.members:
            exchange.partners = tuple(token.members)
            exchange.set_wanted(token.wants)
        exchange.deliver(token.messages)
        self.step()
        token.messages = [
            one for one in token.messages if one.sender != exchange.name
        ] + exchange.take()
        self._working.clear()
        self._last = token
        return token

    def answer(self, probe: LockstepToken) -> LockstepToken:
        """Returns the answer to a probe: the newest period, and whether its work is in progress. Thread-safe."""
        kind = LockstepToken.WORKING if self._working.is_set() else LockstepToken.FINISHED
        return LockstepToken(kind, max(self._period, 0), probe.stamp, [self.exchange.name], [], [])
