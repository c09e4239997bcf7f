"""Plays recorded messages at their recorded pace."""

import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

import rospy

from pioneer_fleet.printable import printable
from pioneer_fleet.recording.recording import Kind, Message
from pioneer_fleet.recording.selection import name_without_master
from pioneer_node.adapters.end_request import EndRequest

_SLICE = 0.1
"""Maximum delay until a jump or a pause takes effect [s]."""


class Pace:
    """Determines when recorded messages are due."""

    def __init__(self, rate: float, end: EndRequest) -> None:
        """``rate`` is the number of recorded seconds per second; ``end`` stops the replay early."""
        self._rate, self._end, self._looked = rate, end, 0.0
        self.jump: int | None = None  #: time to jump to [ns of the recording]; None for no jump
        self.paused = False  #: whether the replay is paused
        self.at = 0
        """Current recorded time [ns]."""

    def begin(self, at: int) -> None:
        """Starts, or continues, at a recorded time [ns]."""
        self.at, self.jump, self._looked = at, None, time.monotonic()

    def waits_for(self, due: int) -> bool:
        """Waits until a message of time ``due`` [ns] is due; returns False if a jump or the end comes first."""
        while not self._end.is_set() and self.jump is None:
            now = time.monotonic()
            if not self.paused:
                self.at += round(1e9 * self._rate * (now - self._looked))
            self._looked = now
            if self.at >= due:
                return True
            self._end.wait(
                _SLICE if self.paused else min(_SLICE, (due - self.at) / 1e9 / self._rate)
            )
        return False


class Replay:
    """Publishes recorded messages on this node's master at their recorded pace, without the masters' topic prefixes."""

    def __init__(self, pace: Pace) -> None:
        self._pace = pace
        self._topics: dict[str, _Topic] = {}

    def play(self, messages: Iterable[Message], at: int = 0) -> int:
        """Publishes all messages from time ``at`` [ns] on, by default from the first; returns their number."""
        count = 0
        began = bool(at)
        if began:
            self._pace.begin(at)
        for message in messages:
            if not began:
                self._pace.begin(message.time)
                began = True
            if not self._pace.waits_for(message.time):
                break
            count += self._topic_of(message).publish(message)
        return count

    def _topic_of(self, message: Message) -> "_Topic":
        name = name_without_master(message.topic)
        if name not in self._topics:
            self._topics[name] = _Topic(name, message.kind)
        return self._topics[name]


class _Topic(rospy.SubscribeListener):
    """Publishes the messages of all recorded senders of one topic.

    A new subscriber gets the last latched message of each sender, as from the recorded nodes. rospy alone would send
    the last message of all: of /tf_static, the transforms of one robot.
    """

    def __init__(self, name: str, kind: Kind) -> None:
        super().__init__()
        self._name = name
        self._type = (kind.type, kind.md5sum)
        self._class = kind.message_class(rospy.AnyMsg)
        self._lock = threading.Lock()
        self._latched: dict[tuple[str, str], Any] = {}
        self._newest: Any = None
        self._warned = False
        self._publisher = rospy.Publisher(
            name, self._class, self, queue_size=100, latch=kind.latching
        )

    def publish(self, message: Message) -> bool:
        """Publishes a message; returns False if it has another type than the topic's first message."""
        kind = message.kind
        if (kind.type, kind.md5sum) != self._type:
            self._warn_of(kind)
            return False
        data = self._class()
        data._buff = message.data
        with self._lock:
            self._newest = data
            if kind.latching:
                # The newest is the last one in the order of insertion.
                key = (message.topic, kind.sender)
                self._latched.pop(key, None)
                self._latched[key] = data
                self._publisher.impl.enable_latch()
            self._publisher.publish(data)
        return True

    def peer_subscribe(self, _: str, __: object, publish: Callable[[Any], None]) -> None:
        """Sends a new subscriber what is latched, unless it is only the newest message, which rospy sends."""
        with self._lock:
            latched = list(self._latched.values())
            if not latched or (len(latched) == 1 and latched[0] is self._newest):
                return
            # As rospy demands of callers of `publish`: other connections share its buffer.
            self._publisher.impl.acquire()
            try:
                for data in latched:
                    publish(data)
            finally:
                self._publisher.impl.release()

    def _warn_of(self, kind: Kind) -> None:
        if not self._warned:
            self._warned = True
            rospy.logwarn(
                "%s: messages of type %s are left out, since it was %s before",
                printable(self._name, ""),
                printable(kind.type, ""),
                printable(self._type[0], ""),
            )
