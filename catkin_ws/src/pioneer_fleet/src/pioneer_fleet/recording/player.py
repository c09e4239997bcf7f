"""Plays recorded messages at their recorded pace."""

import time
from collections.abc import Iterable

import rospy

from pioneer_fleet.recording.recording import Kind, Message
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
        self._publishers: dict[tuple[str, Kind], tuple[rospy.Publisher, type]] = {}

    def play(self, messages: Iterable[Message], at: int = 0) -> int:
        """Publishes all messages from time ``at`` [ns] on, by default from the first; returns their number."""
        count = 0
        if at:
            self._pace.begin(at)
        for message in messages:
            if not count and not at:
                self._pace.begin(message.time)
            if not self._pace.waits_for(message.time):
                break
            publisher, raw = self._publisher(message)
            data = raw()
            data._buff = message.data
            publisher.publish(data)
            count += 1
        return count

    def _publisher(self, message: Message) -> tuple[rospy.Publisher, type]:
        topic = "/" + message.topic.lstrip("/").partition("/")[2]
        key = (topic, message.kind)
        if key not in self._publishers:
            raw = message.kind.message_class(rospy.AnyMsg)
            self._publishers[key] = (
                rospy.Publisher(topic, raw, queue_size=100, latch=message.kind.latching),
                raw,
            )
        return self._publishers[key]
