"""Publishing whole frames without ever waiting for a subscriber.

rospy's own publisher hands each message to a thread per subscriber, or, without a queue, writes and waits. Here the
simulator's thread writes each frame itself, as much as the socket takes at once; what it does not take is kept in a
short queue per subscriber, from which the oldest frame goes when it is full.
"""

import contextlib
import socket
from collections import deque
from typing import Any

import rospy

FRAMES_KEPT = 5


def _bear_late_goodbyes(implementation: Any) -> None:
    """Has a publisher that was closed accept that a subscriber leaves.

    rospy closes publishers, in whatever thread the signal met, while connections of theirs are still being taken down;
    the goodbye of such a connection fails in rospy 1.15 on what closing has set to None.
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
        """Writes a frame or queues it; returns False where an older one had to go for it.

        Raises:
            OSError: the subscriber has gone.
        """
        if not self._rest and not self._queue:
            sent = self._write(frame)
            if sent < len(frame):
                self._rest = bytes(frame[sent:])
            return True
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


class Topic:
    """A publisher of frames. Used from one thread.

    Attributes:
        dropped: frames that a slow subscriber did not get.
    """

    def __init__(self, name: str, message_class: type) -> None:
        """Advertises ``name``."""
        # A queue size keeps rospy from writing, and so from waiting, in this thread; its queues stay empty.
        self._publisher = rospy.Publisher(name, message_class, queue_size=FRAMES_KEPT)
        _bear_late_goodbyes(self._publisher.impl)
        self._outlets: dict[Any, _Outlet] = {}
        self.dropped = 0

    @property
    def wanted(self) -> bool:
        """Whether anybody subscribes."""
        implementation = self._publisher.impl
        return implementation is not None and bool(implementation.connections)

    def send(self, frame: bytes | bytearray) -> None:
        """Sends a frame (length and message) to every subscriber."""
        implementation = self._publisher.impl
        if implementation is None:
            return
        connections = implementation.connections
        if len(self._outlets) > len(connections):
            self._outlets = {key: outlet for key, outlet in self._outlets.items() if key in connections}
        for connection in connections:
            outlet = self._outlets.get(connection)
            try:
                if outlet is None:
                    outlet = self._outlets[connection] = _Outlet(connection)
                if not outlet.send(frame):
                    self.dropped += 1
            except (OSError, AttributeError):  # gone, or closed by rospy in this moment: its socket is None then
                self._outlets.pop(connection, None)
                with contextlib.suppress(Exception):
                    connection.close()
                implementation.remove_connection(connection)

    def close(self) -> None:
        """Takes the topic back."""
        self._outlets.clear()
        self._publisher.unregister()
