"""One topic that crosses: from ROS 1 to ROS 2 while ROS 2 reads it, or the other way while ROS 2 writes it."""

import struct
import threading
import time
from collections.abc import Callable
from typing import Any

import genpy
import roslib.message
import rospy
from rosbags.serde import SerdeError

from pioneer_ros2.dds import Participant, Reader, Writer
from pioneer_ros2.error import TypeUnknownError
from pioneer_ros2.message import Converter, MessageTypes
from pioneer_ros2.rule import Export, Import, Qos
from pioneer_ros2.transform import StaticFrames, message_of, transforms_in, without_prefix

TF = "tf2_msgs/TFMessage"
_TWIST = "geometry_msgs/Twist"
_TWIST_SIZE = 48
_QUEUE = 10
_UNREADABLE = (SerdeError, struct.error, UnicodeDecodeError, ValueError, IndexError)


class RawMessage(genpy.Message):  # type: ignore[misc]
    """A message that is encoded already; ``raw_class`` makes one for each type."""

    __slots__ = ["data"]
    _slot_types = ("uint8[]",)
    _has_header = False
    _type = "*"
    _md5sum = "*"
    _full_text = ""

    def __init__(self, data: bytes = b"") -> None:
        self.data = data

    def serialize(self, buff: Any) -> None:
        """Writes the bytes."""
        buff.write(self.data)

    def deserialize(self, data: bytes) -> "RawMessage":
        """Keeps the bytes."""
        self.data = bytes(data)
        return self


def raw_class(type_name: str) -> type[RawMessage]:
    """Returns a class whose messages go out as ``type_name``, from bytes.

    Raises:
        TypeUnknownError: the type's package is not installed here.
    """
    known = roslib.message.get_message_class(type_name)
    if known is None:
        raise TypeUnknownError(f"{type_name} is not installed on this computer")
    attributes = {
        "__slots__": [],
        "_type": known._type,
        "_md5sum": known._md5sum,
        "_full_text": known._full_text,
        "__doc__": f"{type_name} as bytes.",
    }
    return type(type_name.split("/")[1], (RawMessage,), attributes)


class Counter:
    """Messages that crossed, and those that could not be converted."""

    def __init__(self) -> None:
        self.crossed = 0
        self.unreadable = 0
        self.complaint = ""  #: why the last unreadable one was


class ExportStream:
    """Carries a topic of ROS 1 to ROS 2; subscribes in ROS 1 while there is a reader, or always if it is latched."""

    def __init__(self, export: Export, writer: Writer) -> None:
        self.export = export
        self.counter = Counter()
        self.writer = writer
        self._subscriber: rospy.Subscriber | None = None
        self._statics = (
            StaticFrames()
            if export.qos is Qos.LATCHED and writer.converter.type_name == TF
            else None
        )
        self._period = 1.0 / export.rate if export.rate else 0.0
        self._due = 0.0
        self._lock = threading.Lock()

    @property
    def is_subscribed(self) -> bool:
        """Whether the topic is subscribed in ROS 1."""
        return self._subscriber is not None

    def update(self) -> None:
        """Subscribes or unsubscribes in ROS 1, as the readers in ROS 2 need it."""
        needed = self.writer.readers > 0 or self.export.qos is Qos.LATCHED
        if needed and self._subscriber is None:
            self._subscriber = rospy.Subscriber(
                self.export.source, rospy.AnyMsg, self._carry, queue_size=_QUEUE, tcp_nodelay=True
            )
        elif not needed and self._subscriber is not None:
            self._subscriber.unregister()
            self._subscriber = None

    def _carry(self, message: rospy.AnyMsg) -> None:
        # Several publishers of a topic call from several threads.
        with self._lock:
            if self._period and not self._is_due():
                return
            try:
                data = self._filtered(message._buff)
                if data is not None:
                    self.writer.write(self.writer.converter.to_cdr(data))
                    self.counter.crossed += 1
            except _UNREADABLE as error:
                self.counter.unreadable += 1
                self.counter.complaint = str(error)

    def _is_due(self) -> bool:
        now = time.monotonic()
        if now < self._due:
            return False
        # A stream slower than the limit must not save up messages for later.
        self._due = max(self._due + self._period, now)
        return True

    def _filtered(self, data: bytes) -> bytes | None:
        """Returns the message as it crosses; None if nothing of it does."""
        if self.export.robot:
            kept = list(without_prefix(transforms_in(data), self.export.robot))
            if not kept:
                return None
            data = message_of(kept)
        return self._statics.merged(data) if self._statics else data

    def close(self) -> None:
        """Ends both sides."""
        if self._subscriber is not None:
            self._subscriber.unregister()
        self.writer.close()


class ImportStream:
    """Carries a topic of ROS 2 to ROS 1; publishes in ROS 1 while there is a writer."""

    def __init__(
        self,
        wanted: Import,
        offered: str,
        participant: Participant,
        messages: MessageTypes,
    ) -> None:
        self.wanted = wanted
        self.offered = offered  #: type in ROS 2
        self.counter = Counter()
        self._raw = raw_class(wanted.type)
        known = roslib.message.get_message_class(offered)
        converter = messages.converter(offered, known._full_text if known else "")
        self._to_ros1 = _conversion(converter, wanted.type)
        self._publisher: rospy.Publisher | None = None
        self.reader = Reader(participant, wanted.name, converter, wanted.qos, self._carry)

    @property
    def is_published(self) -> bool:
        """Whether the topic is published in ROS 1."""
        return self._publisher is not None

    def update(self) -> None:
        """Advertises or withdraws the topic in ROS 1, as there are writers in ROS 2."""
        if self.reader.writers and self._publisher is None:
            self._publisher = rospy.Publisher(
                self.wanted.target, self._raw, queue_size=_QUEUE, tcp_nodelay=True
            )
        elif not self.reader.writers and self._publisher is not None:
            publisher = self._publisher
            self._publisher = None
            publisher.unregister()

    def _carry(self, cdr: bytes) -> None:
        publisher = self._publisher
        if publisher is None:
            return
        try:
            publisher.publish(self._raw(self._to_ros1(cdr)))
            self.counter.crossed += 1
        except _UNREADABLE as error:
            self.counter.unreadable += 1
            self.counter.complaint = str(error)
        except rospy.ROSException as error:  # withdrawn at this moment
            self.counter.complaint = str(error)

    def close(self) -> None:
        """Ends both sides."""
        self.reader.close()
        if self._publisher is not None:
            self._publisher.unregister()


def _conversion(converter: Converter, target: str) -> Callable[[bytes], bytes]:
    """Returns the conversion to the type ``target`` of ROS 1.

    Raises:
        TypeUnknownError: the types do not fit.
    """
    if converter.type_name == target:
        return converter.to_ros1
    if target == _TWIST and converter.type_name == "geometry_msgs/TwistStamped":
        # Kilted's Nav2 sends stamped velocities; the twist is the message's end.
        return lambda cdr: converter.to_ros1(cdr)[-_TWIST_SIZE:]
    raise TypeUnknownError(f"ROS 2 sends {converter.type_name}, which does not become {target}")
