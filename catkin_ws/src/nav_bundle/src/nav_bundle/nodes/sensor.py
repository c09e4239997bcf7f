"""Subscriptions that keep the newest messages and unpack them only on access."""

from collections import deque
from typing import Any, Generic, Self, TypeVar

import genpy
import rospy

from pioneer_node.nodes.standing_warning import StandingWarning

_WARNING_PERIOD = 5.0

Message = TypeVar("Message")


def _packed(kind: type[Any]) -> type[Any]:
    """Returns a message class that stays serialised until ``Newest.messages``, since most messages are never read."""

    class Packed(kind):  # type: ignore[misc]
        packed: bytes | None = None
        broken = False

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
        kind: class of its messages.
        depth: number of messages kept: several, because the newest may not parse or be ahead of its transform.
    """

    def __init__(self, topic: str, kind: type[Message], depth: int) -> None:
        self.topic = topic
        self.overdue = StandingWarning(f"messages come on {topic} again")
        self.unusable = StandingWarning(f"messages on {topic} are usable again")
        self._kind = kind
        self._kept: deque[Any] = deque(maxlen=depth)
        self.received: float | None = None
        """ROS time [s] of the last arrival; None before the first."""
        self._subscriber = rospy.Subscriber(topic, _packed(kind), self._store, queue_size=1, tcp_nodelay=True)

    def _store(self, message: Any) -> None:
        self._kept.append(message)
        self.received = rospy.get_time()

    def age(self, now: float) -> float | None:
        """Returns the time [s] since the last arrival; None before the first."""
        return None if self.received is None else now - self.received

    def forget(self) -> None:
        """Drops all messages after the clock jumped back."""
        self._kept.clear()
        self.received = None

    def close(self) -> None:
        """Ends the subscription."""
        self._subscriber.unregister()

    def messages(self) -> list[Message]:
        """Returns the kept messages, newest first."""
        kept = (each for each in reversed(self._kept.copy()) if not each.broken)
        return [each for each in kept if each.packed is None or self._unpack(each)]

    def _unpack(self, message: Any) -> bool:
        try:
            self._kind.deserialize(message, message.packed)  # type: ignore[attr-defined]
        except (genpy.DeserializationError, ValueError) as error:  # the latter from numpy
            rospy.logwarn_throttle(
                _WARNING_PERIOD, f"a message on {self.topic} was dropped, it does not parse: {error}"
            )
            message.broken = True
            return False
        message.packed = None
        return True
