"""Topics that cross: from ROS 1 to ROS 2 while ROS 2 reads them, or the other way while ROS 2 writes them."""

import struct
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from pioneer_node.adapters.node_handle import NodeHandle, Publisher, Subscriber
from pioneer_ros2.dds import DURABILITY, RELIABILITY, Participant, Reader, Writer
from pioneer_ros2.error import TypeUnknownError
from pioneer_ros2.message import Converter, MessageTypes, Ros1Kind
from pioneer_ros2.rule import Export, Import, Qos
from pioneer_ros2.state import State
from pioneer_ros2.transcoder import Bytes, MalformedError
from pioneer_ros2.transform import StaticFrames, by_robot, in_own_frames, message_of

TF = "tf2_msgs/TFMessage"
_TWIST = "geometry_msgs/Twist"
_TWIST_SIZE = 48
_LENGTH = struct.Struct("<I")
_QUEUE = 64
"""Messages of one topic of ROS 2 that wait for the node's thread; beyond them, the oldest are dropped."""
_PATIENCE = 10.0
"""A message for which there is no subscriber in ROS 1 yet waits so long: gateways may have to connect first [s]."""
_RETRY = 0.05
"""How often a message that waits is tried again [s]."""
_MOST_WAITING = 10
"""Messages of one topic that wait for a subscriber; beyond them, the oldest are dropped."""
_LINGER = 5.0
"""A topic stays published in ROS 1 so long after its last writer in ROS 2 has gone [s]."""
_STAYS_FLOODED = 5.0
"""A topic counts as flooded for this long after the last dropped message [s]."""
_UNREADABLE = (MalformedError, struct.error, UnicodeDecodeError)


class Counter:
    """Messages of one topic that crossed, and those that did not."""

    def __init__(self) -> None:
        self.crossed = 0
        self.unreadable = 0
        self.complaint = ""  #: why the last unreadable one was
        self.dropped = 0
        self._flooded_until = 0.0

    def drop(self, count: int = 1) -> None:
        """Counts messages that were dropped because one side is too slow."""
        self.dropped += count
        self._flooded_until = time.monotonic() + _STAYS_FLOODED

    @property
    def is_flooded(self) -> bool:
        """Whether messages were dropped a short time ago."""
        return self.dropped > 0 and time.monotonic() < self._flooded_until

    def unreadable_message(self, error: Exception) -> None:
        """Counts a message that does not follow its type."""
        self.unreadable += 1
        self.complaint = str(error)

    def state(self, name: str, text: str) -> State:
        """Returns the state of the counter's topic: ``text`` unless messages were unreadable or dropped."""
        values = [("messages", str(self.crossed))]
        is_ok = True
        if self.unreadable:
            values.append(("unreadable", str(self.unreadable)))
            text = f"messages cannot be read: {self.complaint}"
            is_ok = False
        if self.dropped:
            values.append(("dropped", str(self.dropped)))
        if self.is_flooded:
            text = "messages are dropped: they come faster than the other side takes them"
            is_ok = False
        return State(name, text, is_ok, tuple(values))


class Outlet:
    """One topic in ROS 2 to which a topic of ROS 1 goes."""

    def __init__(
        self, participant: Participant, export: Export, converter: Converter, frames: int
    ) -> None:
        """Opens the topic; ``frames`` is how many frames its messages begin with."""
        self.export = export
        self._frames = frames
        self._owner = export.source.split("/")[1]
        self.writer = Writer(participant, export.name, converter, export.qos)
        self.counter = Counter()
        self._participant = participant
        self._converter = converter
        self._to_cdr = converter.to_cdr
        self._period = 1.0 / export.rate if export.rate else 0.0
        self._due = 0.0
        is_static = export.qos is Qos.LATCHED and converter.type_name == TF
        self._statics = StaticFrames() if is_static else None
        self.has_readers = False

    @property
    def is_needed(self) -> bool:
        """Whether ROS 2 reads the topic, or may later ask for its last message."""
        return self.has_readers or self.export.qos is Qos.LATCHED

    def update(self) -> None:
        """Looks at the readers; offers the topic with another quality of service if they request it."""
        self.has_readers = self.writer.readers > 0
        if self.writer.refused != DURABILITY or self.export.qos is Qos.LATCHED:
            return
        # A reader asks for the last message at once (transient local). Other readers accept such an offer too.
        self.export = replace(self.export, qos=Qos.LATCHED)
        self.writer.close()
        self.writer = Writer(self._participant, self.export.name, self._converter, self.export.qos)

    def carry(self, data: bytes | memoryview) -> None:
        """Converts a message and sends it."""
        if self._period and not self._is_due():
            return
        try:
            if self._statics is not None:
                data = self._statics.merged(bytes(data))
            if self.export.own_frames:
                data = in_own_frames(data, self._owner, self._frames)
            cdr = self._to_cdr(data)
        except _UNREADABLE as error:
            self.counter.unreadable_message(error)
            return
        if self.writer.write(cdr):
            self.counter.crossed += 1
        else:
            self.counter.drop()

    def _is_due(self) -> bool:
        now = time.monotonic()
        if now < self._due:
            return False
        # A stream slower than the limit must not save up messages for later.
        self._due = max(self._due + self._period, now)
        return True

    def state(self, requested: Mapping[str, set[str]]) -> State:
        """Returns what the topic does.

        Args:
            requested: types under which ROS 2 reads topics, by topic.
        """
        name = f"{self.export.source} to ROS 2 as {self.export.name}"
        own = self._converter.type_name
        others = sorted(requested.get(self.export.name, set()) - {own})
        refused = self.writer.refused
        if others:
            return State(name, f"ROS 2 reads it as {', '.join(others)}, but it is {own}", False)
        if refused:
            text = f"a reader in ROS 2 was refused: it requests another {refused} than is offered"
            return State(name, text, False)
        return self.counter.state(name, "active" if self.has_readers else "no reader in ROS 2")


class ExportTopic:
    """A topic of ROS 1 that is offered in ROS 2, under one name or several; subscribed only while somebody reads it."""

    def __init__(self, node: NodeHandle, source: str, type_name: str) -> None:
        self.source = source
        self.type_name = type_name
        self.outlets: dict[str, Outlet] = {}
        self._node = node
        self._kind = Ros1Kind(type_name)
        self._subscriber: Subscriber | None = None
        self._problem = ""

    def offer(
        self,
        exports: Sequence[Export],
        participant: Participant,
        messages: MessageTypes,
    ) -> None:
        """Opens and closes outlets, so that they are those of ``exports``."""
        names = {export.name for export in exports}
        for name in self.outlets.keys() - names:
            self.outlets.pop(name).writer.close()
        self._problem = ""
        missing = [export for export in exports if export.name not in self.outlets]
        for export in missing:
            try:
                if export.robot and self.type_name != TF:
                    raise TypeUnknownError(f"'{{robot}}' is for {TF}, not for {self.type_name}")
                converter = messages.converter(self.type_name, self._definition())
                self._know(messages.ros1_kind(self.type_name))
                frames = messages.leading_frames(self.type_name)
                if export.own_frames and not frames:
                    raise TypeUnknownError(f"own_frames: {self.type_name} begins with no Header")
                self.outlets[export.name] = Outlet(participant, export, converter, frames)
            except TypeUnknownError as error:
                self._problem = str(error)

    def _definition(self) -> str:
        """Returns the type's definition as a publisher sends it; empty until one is connected."""
        headers = self._subscriber.headers if self._subscriber is not None else []
        for header in headers:
            if header.get("type") == self.type_name:
                return header.get("message_definition", "")
        return ""

    def _know(self, kind: Ros1Kind) -> None:
        """Subscribes from now on with the type's checksum, so that a publisher of another definition is refused."""
        if self._kind._md5sum != kind._md5sum:
            self._kind = kind
            self._unsubscribe()

    def update(self) -> None:
        """Subscribes or unsubscribes as ROS 2 needs it."""
        for outlet in self.outlets.values():
            outlet.update()
        # Without its definition, a type is unknown until a publisher is connected.
        needed = not self.outlets or any(outlet.is_needed for outlet in self.outlets.values())
        if needed and self._subscriber is None:
            self._subscriber = self._node.subscribe_serialised(self.source, self._kind, self._carry)
        elif not needed:
            self._unsubscribe()

    def _unsubscribe(self) -> None:
        if self._subscriber is not None:
            self._subscriber.close()
            self._subscriber = None

    def _carry(self, data: bytes | memoryview, _sender: str) -> None:
        robots: dict[str, bytes] | None = None
        for outlet in self.outlets.values():
            if not outlet.is_needed:
                continue
            if not outlet.export.robot:
                outlet.carry(data)
                continue
            if robots is None:
                robots = self._robots_transforms(data)
            if outlet.export.robot in robots:
                outlet.carry(robots[outlet.export.robot])

    def _robots_transforms(self, data: bytes | memoryview) -> dict[str, bytes]:
        try:
            transforms = by_robot(bytes(data))
        except _UNREADABLE as error:
            for outlet in self.outlets.values():
                outlet.counter.unreadable_message(error)
            return {}
        return {robot: message_of(found) for robot, found in transforms.items()}

    def states(self, requested: Mapping[str, set[str]]) -> Iterator[State]:
        """Yields the state of each outlet, and a problem with the whole topic."""
        for outlet in self.outlets.values():
            yield outlet.state(requested)
        if self._problem:
            yield State(f"{self.source} to ROS 2", f"it does not cross: {self._problem}", False)

    def close(self) -> None:
        """Ends both sides."""
        self._unsubscribe()
        for outlet in self.outlets.values():
            outlet.writer.close()
        self.outlets.clear()


class ImportTopic:
    """A topic of ROS 2 under one of its types, for ROS 1; published there while there is a writer in ROS 2.

    Args:
        node: the door's node.
        rule: topic, names and type.
        offered: type in ROS 2.
        participant: the door's.
        messages: definitions of types.

    Raises:
        TypeUnknownError: a type is unknown, or the types do not fit.
    """

    def __init__(
        self,
        node: NodeHandle,
        rule: Import,
        offered: str,
        participant: Participant,
        messages: MessageTypes,
    ) -> None:
        self.rule = rule
        self.counter = Counter()
        self.is_held = False  #: whether an emergency stop keeps its messages from ROS 1
        self._node = node
        self._participant = participant
        self._kind = messages.ros1_kind(rule.type)
        self._converter = messages.converter(offered)
        self._to_ros1 = _conversion(self._converter, rule.type)
        self._publisher: Publisher | None = None
        self._arrived: deque[bytes] = deque(maxlen=_QUEUE)
        self._waiting: deque[tuple[float, bytes]] = deque()  # with the time of arrival
        self._is_closed = False
        self._undelivered = 0
        self._written_at = 0.0
        self.reader = Reader(participant, rule.name, self._converter, rule.qos, self._receive)

    def update(self) -> None:
        """Advertises or withdraws the topic in ROS 1, and reads with less reliability if a writer offers no more."""
        if self.reader.refused == RELIABILITY:
            # A writer is best effort; a best-effort reader gets the messages of reliable writers too.
            self.reader.close()
            self.reader = Reader(
                self._participant, self.rule.name, self._converter, Qos.SENSOR, self._receive
            )
        now = time.monotonic()
        if self.reader.writers > 0:
            self._written_at = now
            self._opened()
        elif self._publisher is not None and self._is_over(now):
            self._publisher.close()
            self._publisher = None

    def _is_over(self, now: float) -> bool:
        return not self._waiting and now > self._written_at + _LINGER

    def _opened(self) -> Publisher:
        """Returns the topic's publisher in ROS 1."""
        if self._publisher is None:
            self._publisher = self._node.advertise(self.rule.target, self._kind)
        return self._publisher

    def _receive(self, cdr: bytes) -> None:
        """Takes a message, in a thread of Cyclone, and wakes the node's thread."""
        if len(self._arrived) == _QUEUE:
            self.counter.drop()
        self._arrived.append(cdr)
        if len(self._arrived) == 1:
            self._node.call(self._forward)

    def _forward(self) -> None:
        """Sends what has arrived to ROS 1."""
        for _ in range(_QUEUE):
            if not self._arrived:
                return
            self._forward_one(self._arrived.popleft())
        # A flood must not keep the node's thread from everything else.
        self._node.call(self._forward)

    def _forward_one(self, cdr: bytes) -> None:
        if self.is_held or self._is_closed:
            return
        try:
            message = self._to_ros1(cdr)
        except _UNREADABLE as error:
            self.counter.unreadable_message(error)
            return
        now = time.monotonic()
        self._written_at = now
        frame = _LENGTH.pack(len(message)) + message
        publisher = self._opened()
        if publisher.has_subscribers and not self._waiting:
            publisher.send(frame)
            self.counter.crossed += 1
        elif self.rule.qos is not Qos.SENSOR:
            self._wait(now, frame)

    def _wait(self, now: float, frame: bytes) -> None:
        """Keeps a message for a subscriber that may be about to connect, such as a gateway; a velocity would be old."""
        if not self._waiting:
            self._node.call_later(_RETRY, self._deliver)
        self._waiting.append((now, frame))
        if len(self._waiting) > _MOST_WAITING:
            self._waiting.popleft()
            self._undelivered += 1

    def _deliver(self) -> None:
        """Sends what waits if there is a subscriber by now; drops what is too old."""
        if self._is_closed:
            return
        if self.is_held:
            # What waited from before the emergency stop must not move the robot after it.
            self._waiting.clear()
            return
        publisher = self._opened()
        oldest = time.monotonic() - _PATIENCE
        while self._waiting and publisher.has_subscribers:
            publisher.send(self._waiting.popleft()[1])
            self.counter.crossed += 1
        while self._waiting and self._waiting[0][0] < oldest:
            self._waiting.popleft()
            self._undelivered += 1
        if self._waiting:
            self._node.call_later(_RETRY, self._deliver)

    def state(self) -> State:
        """Returns what the topic does."""
        name = f"{self.rule.name} from ROS 2 as {self.rule.target}"
        if self.reader.refused:
            text = f"a publisher in ROS 2 is refused: it offers another {self.reader.refused}"
            return State(name, text, False)
        if self.is_held:
            return State(name, "the robot is held by an emergency stop", False)
        if self.reader.writers == 0:
            return self.counter.state(name, "no publisher in ROS 2")
        if self._publisher is None or not self._publisher.has_subscribers:
            if self._undelivered:
                text = f"no subscriber in ROS 1: messages that it did not get: {self._undelivered}"
                return State(name, text, False)
            return self.counter.state(name, "no subscriber in ROS 1")
        return self.counter.state(name, "active")

    def close(self) -> None:
        """Ends both sides."""
        self._is_closed = True
        self.reader.close()
        if self._publisher is not None:
            self._publisher.close()


def _conversion(converter: Converter, target: str) -> Bytes:
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
