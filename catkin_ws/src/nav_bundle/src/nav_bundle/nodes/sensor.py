"""What subscriptions leave behind: the newest messages, unpacked when somebody looks."""

from collections import deque
from typing import Any, Generic, Self, TypeVar

import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2

from nav_bundle.conversions import ScanMessage

Message = TypeVar("Message")


class _PackedOdometry(Odometry):  # type: ignore[misc]
    """An Odometry that keeps its bytes: most of those that arrive are never looked at."""

    packed: bytes | None = None

    def deserialize(self, data: bytes) -> Self:
        """Keeps the message's bytes."""
        self.packed = bytes(data)
        return self


class _PackedScan(ScanMessage):
    """A LaserScan that keeps its bytes until ``unpacked``."""

    packed: bytes | None = None

    def deserialize(self, data: bytes) -> Self:
        """Keeps the message's bytes."""
        self.packed = bytes(data)
        return self


class _PackedCloud(PointCloud2):  # type: ignore[misc]
    """A PointCloud2 that keeps its bytes until ``unpacked``."""

    packed: bytes | None = None

    def deserialize(self, data: bytes) -> Self:
        """Keeps the message's bytes."""
        self.packed = bytes(data)
        return self


class Newest(Generic[Message]):
    """The newest few messages of a topic and when the last one came.

    Threads: rospy's subscriber thread appends; anyone may read.
    """

    def __init__(self, topic: str, packed: type[Any], kind: type[Message], depth: int) -> None:
        self.topic = topic
        self._kind = kind
        self._kept: deque[Any] = deque(maxlen=depth)
        self.received: float | None = None
        """ROS time [s] of the last arrival, None before the first."""
        self._subscriber = rospy.Subscriber(topic, packed, self._store, queue_size=1, tcp_nodelay=True)

    def _store(self, message: Any) -> None:
        self._kept.append(message)
        self.received = rospy.get_time()

    def age(self, now: float) -> float | None:
        """Returns the time [s] since the last arrival, None before the first."""
        return None if self.received is None else now - self.received

    def forget(self) -> None:
        """Drops what was kept, for a clock that jumped back."""
        self._kept.clear()
        self.received = None

    def close(self) -> None:
        """Ends the subscription."""
        self._subscriber.unregister()

    def messages(self) -> list[Message]:
        """Returns the kept messages, the newest first."""
        unpacked = []
        for message in reversed(self._kept.copy()):
            if message.packed is not None:
                self._kind.deserialize(message, message.packed)  # type: ignore[attr-defined]
                message.packed = None
            unpacked.append(message)
        return unpacked


def newest_odometry(topic: str) -> Newest[Odometry]:
    """Subscribes to odometry."""
    return Newest(topic, _PackedOdometry, Odometry, 1)


def newest_scans(topic: str) -> Newest[ScanMessage]:
    """Subscribes to a laser; keeps a few scans, because the newest may be ahead of its transform."""
    return Newest(topic, _PackedScan, ScanMessage, 4)


def newest_clouds(topic: str) -> Newest[PointCloud2]:
    """Subscribes to a sensor of points in space; keeps a few clouds."""
    return Newest(topic, _PackedCloud, PointCloud2, 4)
