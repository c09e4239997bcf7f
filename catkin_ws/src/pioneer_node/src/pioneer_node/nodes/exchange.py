"""What a process in lockstep publishes and subscribes: through tokens, in place of rospy's connections.

rospy's subscribers call back whenever a message happens to arrive, its timers whenever a thread happens to wake. Here
both happen at one place of a period, in an order that only the messages themselves decide (docs/lockstep.md).
"""

import hashlib
import io
import threading
from collections.abc import Callable, Collection, Iterable
from typing import Any, Self

import rospy
from pioneer_msgs.msg import LockstepMessage
from rospy.msg import args_kwds_to_message

_STREAMS = {"sensor_msgs/LaserScan", "sensor_msgs/PointCloud2", "nav_msgs/Odometry", "rosgraph_msgs/Clock"}
"""Types of which a member takes no messages but those of its tokens: a connection would carry each a second time."""


class Exchange:
    """Replaces ``rospy.Publisher``, ``Subscriber`` and ``Timer`` of this process by ones that work by tokens.

    What is published still goes to those who subscribe by rospy. A subscriber still gets what others publish that do
    not take part, but no scans, point clouds, odometry, ``/clock`` and ``/tf`` of theirs.

    Threads: ``deliver``, ``run_timers`` and ``take`` belong to the one that handles tokens; any may publish.
    """

    current: "Exchange | None" = None
    """Of this process, where it takes part."""

    def __init__(self, name: str) -> None:
        self.name = name  #: of this node
        self.partners: tuple[str, ...] = ()  #: nodes that take part, this one too, whose messages come in tokens
        self.timers: list[_Timer] = []
        self.latched: list[_Publisher] = []
        self.wanted: frozenset[str] = frozenset()  #: topics to which anybody in lockstep subscribes
        self._listeners: dict[str, list[_Subscriber]] = {}
        self._sent: list[LockstepMessage] = []
        self._parts: dict[str, dict[bytes, bytes]] = {}
        self._lock = threading.Lock()

    def install(self, follows: bool = True) -> Self:
        """Replaces rospy's classes; ROS time is what tokens say where this process ``follows`` them. Returns itself."""
        Exchange.current = self
        rospy.Publisher, rospy.Subscriber, rospy.Timer = _Publisher, _Subscriber, _Timer
        if follows:
            if (clock := getattr(rospy.impl.simtime, "_clock_sub", None)) is not None:
                clock.unregister()
            set_time(rospy.Time())
        return self

    def topics(self) -> list[str]:
        """Returns the names of all topics that this process subscribes to."""
        return sorted(self._listeners)

    def wants(self, topic: str) -> bool:
        """Returns whether anybody in lockstep subscribes to a topic."""
        return topic in self.wanted

    def set_wanted(self, topics: Iterable[str]) -> None:
        """Takes the topics to which anybody in lockstep subscribes; latched messages reach those that are new."""
        before, self.wanted = self.wanted, frozenset(topics)
        for publisher in self.latched:
            topic = publisher.resolved_name
            if publisher.kept is not None and topic in self.wanted and topic not in before:
                self.note(topic, publisher.kept)

    def listen(self, topic: str, subscriber: "_Subscriber") -> None:
        """Has a subscriber get what tokens carry of a topic."""
        self._listeners.setdefault(topic, []).append(subscriber)

    def ignore(self, topic: str, subscriber: "_Subscriber") -> None:
        """Ends that."""
        self._listeners[topic].remove(subscriber)
        if not self._listeners[topic]:
            del self._listeners[topic]

    def note(self, topic: str, data: bytes) -> None:
        """Keeps a serialised message for the next token."""
        with self._lock:
            self._sent.append(LockstepMessage(self.name, topic, data))

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
        """Calls this process's subscribers, in the messages' order."""
        for message in messages:
            for subscriber in tuple(self._listeners.get(message.topic, ())):
                subscriber.receive(message)

    def run_timers(self) -> None:
        """Calls the timers that are due."""
        for timer in tuple(self.timers):
            timer.run_if_due(rospy.Time.now())


def set_time(now: rospy.Time) -> None:
    """Has ROS time be ``now`` in this process."""
    rospy.rostime._set_rostime(now)


def _exchange() -> Exchange:
    assert Exchange.current is not None, "only while installed"
    return Exchange.current


class _Publisher(rospy.topics.Publisher):  # type: ignore[misc]
    """Publishes as rospy does, and into the next token."""

    def __init__(self, name: str, data_class: Any, *args: Any, latch: bool = False, **options: Any) -> None:
        super().__init__(name, data_class, *args, latch=latch, **options)
        self.kept: bytes | None = None
        self._latch = latch
        if latch:
            _exchange().latched.append(self)

    def publish(self, *args: Any, **fields: Any) -> None:
        """Publishes a message, given as itself or by its fields."""
        message, exchange = args_kwds_to_message(self.data_class, args, fields), _exchange()
        wanted = exchange.wants(self.resolved_name)
        if wanted or self._latch:
            buffer = io.BytesIO()
            message.serialize(buffer)
            self.kept = buffer.getvalue() if self._latch else None
            if wanted:
                exchange.note(self.resolved_name, buffer.getvalue())
        super().publish(message)

    def get_num_connections(self) -> int:
        """Returns the number of subscribers; all those in lockstep count as one."""
        return int(super().get_num_connections()) + _exchange().wants(self.resolved_name)

    def unregister(self) -> None:
        """Takes the topic back."""
        if self in _exchange().latched:
            _exchange().latched.remove(self)
        super().unregister()


class _Subscriber(rospy.topics.Subscriber):  # type: ignore[misc]
    """Gets what tokens carry, and from those who do not take part what rospy does."""

    def __init__(
        self, name: str, data_class: Any, callback: Any = None, callback_args: Any = None, **options: Any
    ) -> None:
        self._kind, self._function, self._arguments = data_class, callback, callback_args
        self._kept: dict[str, bytes] = {}
        topic = rospy.resolve_name(name)
        self._connected = data_class._type not in _STREAMS and topic != "/tf"
        _exchange().listen(topic, self)
        if self._connected:
            super().__init__(name, data_class, self._hear, **options)
        else:
            self.resolved_name, self.impl = topic, None

    def receive(self, message: LockstepMessage) -> None:
        """Takes a message of a token."""
        own = self._kind()
        own._connection_header = {"callerid": message.sender, "topic": message.topic}
        own.deserialize(message.data)
        self._call(own)

    def _hear(self, message: Any) -> None:
        # A gateway's node for a publisher elsewhere is called after both.
        header = message._connection_header
        sender = header["callerid"]
        if sender.endswith(_exchange().partners or ("\0",)):
            return
        if header.get("latching") == "1" and not self._is_new(sender, message):
            return
        self._call(message)

    def _is_new(self, sender: str, message: Any) -> bool:
        """Returns whether a latched message is another than the last; after a link was lost the same comes again."""
        buffer = io.BytesIO()
        message.serialize(buffer)
        before, self._kept[sender] = self._kept.get(sender), hashlib.sha256(buffer.getbuffer()).digest()
        return self._kept[sender] != before

    def _call(self, message: Any) -> None:
        if self._arguments is None:
            self._function(message)
        else:
            self._function(message, self._arguments)

    def unregister(self) -> None:
        """Ends the subscription."""
        _exchange().ignore(self.resolved_name, self)
        if self._connected:
            super().unregister()


class _Timer:
    """``rospy.Timer`` without a thread: called by `Exchange.run_timers`."""

    def __init__(
        self, period: rospy.Duration, callback: Callable[[Any], None], oneshot: bool = False, reset: bool = False
    ) -> None:
        del reset  # time in lockstep jumps back only where a simulator starts again, and the due time with it
        self._period, self._callback, self._oneshot = period, callback, oneshot
        self._due = rospy.Time.now() + period
        self._last: rospy.Time | None = None
        _exchange().timers.append(self)

    def run_if_due(self, now: rospy.Time) -> None:
        """Calls back where the time has come."""
        if now < self._due:
            if self._due - now > self._period:
                self._due = now + self._period
            return
        due, self._due = self._due, max(self._due + self._period, now)
        self._callback(rospy.timer.TimerEvent(self._last, self._last, due, now, None))
        self._last = now
        if self._oneshot:
            self.shutdown()

    def shutdown(self) -> None:
        """Ends the timer."""
        if self in _exchange().timers:
            _exchange().timers.remove(self)
