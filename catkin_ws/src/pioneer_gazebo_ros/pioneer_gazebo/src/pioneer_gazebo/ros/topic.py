"""Publishes serialised frames without blocking on subscribers.

rospy's own publisher passes each message to a thread per subscriber or, without a queue, blocks while writing. Here the
simulator's thread writes each frame itself, as much as the socket accepts at once. The rest is kept in a short queue
per subscriber, which drops its oldest frame when it is full.
"""

import contextlib
import socket
from collections import deque
from collections.abc import Callable
from typing import Any
from weakref import WeakKeyDictionary

import rospy
from tf2_msgs.msg import TFMessage

from pioneer_gazebo.error import TopicError
from pioneer_gazebo.ros import messages
from pioneer_node.nodes.exchange import Exchange

FRAMES_KEPT = 5
_LENGTH = 4
"""Length of the frame header [bytes]."""


def _bear_late_goodbyes(implementation: Any) -> None:
    """Makes a closed publisher accept that a subscriber disconnects.

    rospy closes publishers, in whichever thread received the signal, while other threads are still removing their
    connections. In rospy 1.15 such a removal fails on attributes that closing has set to None.
    """
    remove = implementation.remove_connection

    def remove_or_be_closed(connection: Any) -> None:
        try:
            remove(connection)
        except (AttributeError, TypeError):
            if not implementation.closed:
                raise

    implementation.remove_connection = remove_or_be_closed


class _Outlet:
    """One subscriber's connection."""

    __slots__ = ("_queue", "_rest", "_socket")

    def __init__(self, connection: Any) -> None:
        self._socket: socket.socket = connection.socket
        self._queue: deque[bytes] = deque()
        self._rest = b""
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _write(self, data: bytes | bytearray) -> int:
        try:
            return self._socket.send(data, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return 0

    def send(self, frame: bytes | bytearray) -> bool:
        """Writes a frame or queues it; returns False if an older frame was dropped for it.

        Raises:
            OSError: the subscriber has disconnected.
        """
        if self._rest or self._queue:
            return self._queued(frame)
        sent = self._write(frame)
        if sent < len(frame):
            self._rest = bytes(frame[sent:])
        return True

    def _queued(self, frame: bytes | bytearray) -> bool:
        self._queue.append(bytes(frame))
        self._flush()
        if len(self._queue) <= FRAMES_KEPT:
            return True
        self._queue.popleft()
        return False

    def _flush(self) -> None:
        while self._rest or self._queue:
            if not self._rest:
                self._rest = self._queue.popleft()
            self._rest = self._rest[self._write(self._rest) :]
            if self._rest:
                return


def publish_while_alive(publisher: rospy.Publisher, message: Any) -> None:
    """Publishes through rospy; ignores errors during shutdown, when rospy closes publishers in another thread."""
    try:
        publisher.publish(message)
    except rospy.ROSException:
        if not rospy.is_shutdown():
            raise


def check_type(name: str, message_class: type) -> None:
    """Checks that this process does not publish messages of another type on a topic, which rospy would accept.

    Raises:
        TopicError: it does; the message names both types.
    """
    known = rospy.topics.get_topic_manager().get_publisher_impl(rospy.resolve_name(name))
    if known is not None and known.data_class is not message_class:
        raise TopicError(
            f"topic {rospy.resolve_name(name)} has the type {known.data_class._type} already:"
            f" {message_class._type} is not published on it"  # type: ignore[attr-defined]
        )


_OUTLETS: WeakKeyDictionary[Any, _Outlet] = WeakKeyDictionary()
"""The outlet of each connection: topics of one name share their connections."""


class Topic(rospy.SubscribeListener):
    """A publisher of serialised frames. Used from one thread; rospy reports subscribers in its own threads."""

    def __init__(
        self, name: str, message_class: type, changed: Callable[[], None] = lambda: None
    ) -> None:
        """Advertises ``name``; ``changed`` is called, in any thread, when a subscriber connects or disconnects.

        Raises:
            TopicError: the topic has another type already.
        """
        check_type(name, message_class)
        self._changed = changed
        self._outlets: dict[Any, _Outlet] = {}
        self._stale = True
        self.exchange = (
            Exchange.current
        )  #: carries messages to nodes in lockstep; None without lockstep
        self._name = rospy.resolve_name(name)
        # With a queue size, rospy does not write, and thus never blocks, in this thread; its queues stay empty.
        self._publisher = rospy.Publisher(
            name, message_class, subscriber_listener=self, queue_size=FRAMES_KEPT
        )
        _bear_late_goodbyes(self._publisher.impl)

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        """Called by rospy when a subscriber connects."""
        del topic_name, topic_publish, peer_publish
        self._stale = True
        self._changed()

    def peer_unsubscribe(self, topic_name: str, num_peers: int) -> None:
        """Called by rospy when a subscriber disconnects."""
        del topic_name, num_peers
        self._stale = True
        self._changed()

    @property
    def wanted(self) -> bool:
        """Whether there are subscribers."""
        if self.exchange is not None and self.exchange.wants(self._name):
            return True
        implementation = self._publisher.impl
        return implementation is not None and bool(implementation.connections)

    def send(self, frame: bytes | bytearray) -> None:
        """Sends a frame (length and message) to all subscribers, including those in lockstep."""
        if self.exchange is not None and self.exchange.wants(self._name):
            self.exchange.sample(self._name, bytes(frame[_LENGTH:]))
        self.write(frame)

    def write(self, frame: bytes | bytearray) -> None:
        """Sends a frame to all connected subscribers."""
        if self._stale:
            self._renew()
        gone = []
        for connection, outlet in self._outlets.items():
            try:
                outlet.send(frame)
            except OSError:
                gone.append(connection)
        for connection in gone:
            self._drop(connection)

    def _renew(self) -> None:
        """Updates the outlets from rospy's connections; one that is just being closed has no socket."""
        self._stale = False
        implementation = self._publisher.impl
        connections = implementation.connections if implementation is not None else ()
        self._outlets = {
            connection: _outlet_of(connection)
            for connection in connections or ()
            if connection.socket is not None
        }

    def _drop(self, connection: Any) -> None:
        del self._outlets[connection]
        with contextlib.suppress(Exception):
            connection.close()
        if (implementation := self._publisher.impl) is not None:
            implementation.remove_connection(connection)

    def close(self) -> None:
        """Unregisters the topic."""
        self._outlets.clear()
        self._publisher.unregister()


def _outlet_of(connection: Any) -> _Outlet:
    outlet = _OUTLETS.get(connection)
    if outlet is None:
        outlet = _OUTLETS[connection] = _Outlet(connection)
    return outlet


class SilentTopic(Topic):
    """Takes the place of a topic that cannot be advertised: it has no subscribers and sends nothing."""

    def __init__(self) -> None:
        self.exchange = None

    @property
    def wanted(self) -> bool:
        """Returns False."""
        return False

    def write(self, frame: bytes | bytearray) -> None:
        """Sends nothing."""

    def close(self) -> None:
        """Does nothing."""


class TransformTopic(Topic):
    """``/tf``: collects the transforms of all robots at a tick and sends them in one message."""

    def __init__(self, changed: Callable[[], None]) -> None:
        """Advertises ``/tf``; ``changed`` as in `Topic`."""
        super().__init__("/tf", TFMessage, changed)
        self._transforms: list[bytes] = []

    def add(self, transform: bytes) -> None:
        """Adds a serialised transform to the next message."""
        self._transforms.append(transform)

    def flush(self) -> None:
        """Sends the collected transforms, if any."""
        if self._transforms:
            if self.exchange is not None:
                for one in self._transforms:
                    self.exchange.sample("/tf", one, messages.name_of_transform(one))
            self.write(messages.transforms_frame(self._transforms))
            self._transforms.clear()
