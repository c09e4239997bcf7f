"""What stands between a publisher and one subscriber: messages are written by the thread that publishes them."""

import socket
import threading
from collections import deque
from typing import Any

from rospy.exceptions import TransportException


class DirectConnection:
    """Replaces rospy's ``QueuedConnection``, and keeps its queue for what a subscriber does not take at once.

    rospy hands each message to a thread for each subscriber and gives the processor up for it: two changes of thread,
    and a thread that does nothing else. Here the socket takes most messages without waiting. Only from the first one
    that it does not take whole, until all is written, a thread writes, and of what waits for it
    ``queue_size`` messages are kept, the newest.
    """

    def __init__(self, connection: Any, queue_size: int) -> None:
        """Takes rospy's transport, and how many messages may wait; 0 for any number."""
        self._connection = connection
        self._queue: deque[bytes] = deque(maxlen=queue_size or None)
        self._rest = b""
        self._writing = False
        self._error: Exception | None = None
        self._lock = threading.Lock()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._connection, name)

    def write_data(self, data: bytes) -> bool:
        """Writes a message with its length, or queues it; never waits for the subscriber.

        Raises:
            Exception: what the transport raised for this message, or for one before it that had been queued.
        """
        with self._lock:
            if self._error is not None:
                error, self._error = self._error, None
                raise error
            if self._writing:
                self._queue.append(data)
                return True
            sent = self._write(data)
            if sent < len(data):
                self._rest = data[sent:]
                self._writing = True
                threading.Thread(target=self._write_queue, name="slow-subscriber", daemon=True).start()
        return True

    def _write(self, data: bytes) -> int:
        """Returns how many bytes the socket has taken; all of them where the transport itself had to write, or fail."""
        target = self._connection.socket
        if target is None or self._connection.done:
            self._connection.write_data(data)
            return len(data)
        try:
            sent = int(target.send(data, socket.MSG_DONTWAIT))
        except BlockingIOError:
            return 0
        except OSError:
            self._connection.write_data(data)  # it closes the connection as it does for any error
            return len(data)
        self._connection.stat_bytes += sent
        self._connection.stat_num_msg += sent == len(data)
        return sent

    def _write_queue(self) -> None:
        while (data := self._next()) is not None:
            try:
                self._connection.write_data(data)
            except (TransportException, OSError, AttributeError) as error:  # the last if it is closed meanwhile
                with self._lock:
                    self._error = error

    def _next(self) -> bytes | None:
        """Returns what is to be written next; None, and the thread ends, where nothing waits any more."""
        with self._lock:
            if self._connection.done:  # nobody will take it any more
                self._rest = b""
                self._queue.clear()
            data, self._rest = self._rest or (self._queue.popleft() if self._queue else b""), b""
            self._writing = bool(data)
            return data or None
