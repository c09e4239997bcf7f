"""A publisher's connection to one subscriber, on which the publishing thread itself writes the messages."""

import socket
import threading
from collections import deque
from typing import Any

from rospy.exceptions import TransportException


class DirectConnection:
    """Replaces rospy's ``QueuedConnection``; queues only what a slow subscriber does not accept at once.

    rospy hands each message to one thread per subscriber and yields the processor: two context switches per message,
    and a dedicated thread. Here most messages fit into the socket buffer without blocking. Only when one does not fit,
    a thread takes over until everything is written. Meanwhile the newest ``queue_size`` messages are queued.
    """

    def __init__(self, connection: Any, queue_size: int) -> None:
        """Takes rospy's transport and the maximum queue length; 0 for no limit."""
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
        """Writes a length-prefixed message, or queues it; never blocks on the subscriber.

        Raises:
            Exception: whatever the transport raised for this message, or for an earlier queued one.
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
                threading.Thread(
                    target=self._write_queue, name="slow-subscriber", daemon=True
                ).start()
        return True

    def _write(self, data: bytes) -> int:
        """Returns how many bytes the socket accepted; all of them if the message was handed to the transport."""
        target = self._connection.socket
        if target is None or self._connection.done:
            self._connection.write_data(data)
            return len(data)
        try:
            sent = int(target.send(data, socket.MSG_DONTWAIT))
        except BlockingIOError:
            return 0
        except OSError:
            self._connection.write_data(
                data
            )  # handles the error as usual and closes the connection
            return len(data)
        self._connection.stat_bytes += sent
        self._connection.stat_num_msg += sent == len(data)
        return sent

    def _write_queue(self) -> None:
        while (data := self._next()) is not None:
            try:
                self._connection.write_data(data)
            except (
                TransportException,
                OSError,
                AttributeError,
            ) as error:  # AttributeError if closed meanwhile
                with self._lock:
                    self._error = error

    def _next(self) -> bytes | None:
        """Returns the next data to write; None, which ends the thread, if the queue is empty."""
        with self._lock:
            if self._connection.done:  # the connection is closed
                self._rest = b""
                self._queue.clear()
            data, self._rest = self._rest or (self._queue.popleft() if self._queue else b""), b""
            self._writing = bool(data)
            return data or None
