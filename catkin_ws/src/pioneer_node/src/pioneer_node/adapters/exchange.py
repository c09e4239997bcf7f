"""What the messages of a node in lockstep have to do with tokens, and what it does with a token (docs/lockstep.md)."""

import hashlib
import threading
from collections.abc import Callable, Collection, Hashable, Iterable, Sequence
from typing import Any

from pioneer_msgs.msg import LockstepMessage, LockstepToken

from pioneer_node.core.ring import INLET, OUTLET, PROBE, ring_topic

_STREAMS = {"sensor_msgs/LaserScan", "sensor_msgs/PointCloud2", "nav_msgs/Odometry", "rosgraph_msgs/Clock"}
"""Types of which a member takes no messages but those of its tokens: a connection would carry each a second time."""

Take = Callable[[LockstepMessage], object]


def is_connected(kind: Any, topic: str) -> bool:
    """Returns whether a member takes a topic's messages by connections, too, from nodes that do not take part."""
    return kind._type not in _STREAMS and topic != "/tf"


class Exchange:
    """Messages of one node from and for tokens. What it publishes still goes to all other subscribers, too.

    Threads: ``deliver`` and ``take`` belong to the one that handles tokens; any may publish.
    """

    def __init__(self, name: str) -> None:
        self.name = name  #: of this node
        self.partners: tuple[str, ...] = ()  #: nodes that take part, this one too, whose messages come in tokens
        self.wanted: frozenset[str] = frozenset()  #: topics to which anybody in lockstep subscribes
        self._listeners: dict[str, list[Take]] = {}
        self._latched: dict[tuple[str, Hashable], bytes] = {}
        self._sent: list[LockstepMessage] = []
        self._parts: dict[str, dict[bytes, bytes]] = {}
        self._heard: dict[tuple[str, str], bytes] = {}
        self._lock = threading.Lock()

    def topics(self) -> list[str]:
        """Returns the names of all topics that this node subscribes to."""
        return sorted(self._listeners)

    def wants(self, topic: str) -> bool:
        """Returns whether anybody in lockstep subscribes to a topic."""
        return topic in self.wanted

    def set_wanted(self, topics: Iterable[str]) -> None:
        """Takes the topics to which anybody in lockstep subscribes; latched messages reach those that are new."""
        before, self.wanted = self.wanted, frozenset(topics)
        for (topic, _), data in tuple(self._latched.items()):
            if topic in self.wanted and topic not in before:
                self.note(topic, data)

    def listen(self, topic: str, take: Take) -> None:
        """Has ``take`` called with what tokens carry of a topic."""
        self._listeners.setdefault(topic, []).append(take)

    def ignore(self, topic: str, take: Take) -> None:
        """Ends that."""
        self._listeners[topic].remove(take)
        if not self._listeners[topic]:
            del self._listeners[topic]

    def note(self, topic: str, data: bytes) -> None:
        """Keeps a serialised message for the next token."""
        with self._lock:
            self._sent.append(LockstepMessage(self.name, topic, data))

    def keep(self, topic: str, publisher: Hashable, data: bytes | None) -> None:
        """Keeps the last message of a publisher that latches, for topics that are wanted later; None for no more."""
        if data is None:
            self._latched.pop((topic, publisher), None)
        else:
            self._latched[topic, publisher] = data

    def sample(self, topic: str, data: bytes, part: bytes = b"") -> None:
        """Keeps the newest message of a topic for the next token, or of each ``part`` of one; see `take`."""
        self._parts.setdefault(topic, {})[part] = data

    def take(self, join: Callable[[Collection[bytes]], bytes] = b"".join) -> list[LockstepMessage]:
        """Returns the messages since the last call: samples by topic, then the others as they were published.

        Args:
            join: makes one message of the parts of a topic.
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
        """Calls this node's subscribers, in the messages' order."""
        for message in messages:
            for take in tuple(self._listeners.get(message.topic, ())):
                take(message)

    def accepts(self, topic: str, sender: str, latched: bool, data: Callable[[], bytes]) -> bool:
        """Returns whether a message that came by a connection counts.

        Those of partners come in tokens. After a link was lost, a latched message comes again, which is ignored.

        Args:
            topic: its name.
            sender: the publisher; a gateway's node for one elsewhere is called after both.
            latched: whether that one latches.
            data: returns the message as it is serialised.
        """
        if sender.endswith(self.partners or ("\0",)):
            return False
        if not latched:
            return True
        before, found = self._heard.get((topic, sender)), hashlib.sha256(data()).digest()
        self._heard[topic, sender] = found
        return before != found


class Place:
    """A member's place in its ring: what it does with tokens. Each call has returned before the next begins.

    Args:
        exchange: the node's.
        ring: the ring's name.
        members: its members, in the order in which they act.
        name: this one's name among them.
        set_time: gets a token's time.
    """

    def __init__(
        self, exchange: Exchange, ring: str, members: Sequence[str], name: str, set_time: Callable[[Any], object]
    ) -> None:
        self.exchange = exchange
        exchange.partners = tuple(f"/{ring}/{one}" if ring else f"/{one}" for one in members)
        place = list(members).index(name)
        #: topics: where tokens come, where they go, where probes come, and where they are answered
        self.inlet = ring_topic(ring, INLET if place == 0 else f"after_{members[place - 1]}")
        self.outlet = ring_topic(ring, OUTLET if place == len(members) - 1 else f"after_{name}")
        self.probe, self.answers = ring_topic(ring, PROBE), ring_topic(ring, OUTLET)
        self.step: Callable[[], object] = lambda: None  #: does one period's work
        self.ready: Callable[[], bool] = lambda: True  #: whether the node has what it needs before the first period
        self._set_time = set_time
        self._working = threading.Event()
        self._period = -1  # until it has joined
        self._last: LockstepToken | None = None

    def take(self, token: LockstepToken) -> LockstepToken | None:
        """Does what a token asks; returns the one to pass on, if there is one."""
        if token.kind == LockstepToken.JOIN:
            return self._join(token)
        if self._last is not None and token.period == self._last.period:
            return self._last  # sent again because it was lost, here or behind
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
        token.messages = [one for one in token.messages if one.sender != exchange.name] + exchange.take()
        self._working.clear()
        self._last = token
        return token

    def answer(self, probe: LockstepToken) -> LockstepToken:
        """Returns the answer to a probe: the newest period, and whether its work is under way. From any thread."""
        kind = LockstepToken.WORKING if self._working.is_set() else LockstepToken.FINISHED
        return LockstepToken(kind, max(self._period, 0), probe.stamp, [self.exchange.name], [], [])
