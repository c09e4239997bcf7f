"""Subscriptions that keep the newest messages and unpack them only on access."""

from collections import deque
from collections.abc import Iterator
from typing import Any, Generic, Self, TypeVar

import genpy
import rospy

from nav_bundle.costmap.source import Arrival
from pioneer_node.nodes.standing_warning import StandingWarning

_WARNING_PERIOD = 5.0

Message = TypeVar("Message")


def _packed(kind: type[Any]) -> type[Any]:
    """Returns a message class that stays serialised until ``Newest.arrivals``, since most messages are never read."""

    class Packed(kind):  # type: ignore[misc]
        packed: bytes | None = None
        broken = False
        number = 0
        received = 0.0

        def deserialize(self, data: bytes) -> Self:
            """Keeps the message's bytes."""
            self.packed = bytes(data)
            return self

    return Packed


class Newest(Generic[Message]):
    """The newest few messages of a topic, and the arrival time of the last one.

    Threads: rospy's subscriber thread appends; any thread may read.

    On error: a message that does not parse is dropped with a warning.

    Args:
        topic: name of the topic.
        kind: class of its messages, which have a header.
        depth: number of messages kept: several, because the newest may not parse or be ahead of its transform.
    """

    def __init__(self, topic: str, kind: type[Message], depth: int) -> None:
        self.topic = topic
        self.overdue = StandingWarning(f"messages come on {topic} again")
        self.unusable = StandingWarning(f"messages on {topic} are usable again")
        self._kind = kind
        self._kept: deque[Any] = deque(maxlen=depth)
        self._count = 0
        self.received: float | None = None
        """ROS time [s] of the last arrival; None before the first."""
        self._subscriber = rospy.Subscriber(
            topic, _packed(kind), self._store, queue_size=1, tcp_nodelay=True
        )

    def _store(self, message: Any) -> None:
        self._count += 1
        message.number = self._count
        message.received = rospy.get_time()
        self._kept.append(message)
        self.received = message.received

    def forget(self) -> None:
        """Drops all messages after the clock jumped back."""
        self._kept.clear()
        self.received = None

    def close(self) -> None:
        """Ends the subscription."""
        self._subscriber.unregister()

    def arrivals(self) -> Iterator[Arrival[Message]]:
        """Yields the kept messages that parse, newest first; unpacks each only when it is reached."""
        for message in reversed(self._kept.copy()):
            if not message.broken and (message.packed is None or self._unpack(message)):
                yield Arrival(
                    message.number, message.received, message.header.stamp.to_sec(), message
                )

    def _unpack(self, message: Any) -> bool:
        try:
            self._kind.deserialize(message, message.packed)  # type: ignore[attr-defined]
        except (genpy.DeserializationError, ValueError) as error:  # the latter from numpy
            rospy.logwarn_throttle(
                _WARNING_PERIOD,
                f"a message on {self.topic} was dropped, it does not parse: {error}",
            )
            message.broken = True
            return False
        message.packed = None
        return True
