"""A bounded send queue for one receiver. It drops whole messages, oldest first.

It has no socket: the owner asks what to send next and reports how much was sent. A message whose transmission has
begun is always completed, so the receiver never loses frame alignment.
"""

import enum
import sys
from collections import deque
from collections.abc import Iterator
from itertools import islice

from tcpros.frame import Chunk

BATCH = 64 * 1024
"""Bytes committed for sending at a time, rounded up to whole messages; committed messages are no longer dropped."""

UNBOUNDED = sys.maxsize
"""A limit that is never reached."""

MAX_BUFFERS = 512
"""Maximum number of buffers per system call (Linux allows 1024)."""


class _Rest(enum.Enum):
    """How to treat the rest of the frame that is arriving."""

    NONE = enum.auto()  # between two frames
    SEND = enum.auto()  # its beginning was sent or is committed
    HOLD = enum.auto()  # its beginning is the last queued message and may be dropped
    SKIP = enum.auto()  # its beginning was missed


class Backlog:
    """The send queue between a stream of frames and one receiver."""

    def __init__(self, max_messages: int, max_bytes: int) -> None:
        self.drops = 0  #: messages dropped so far
        self._max_messages = max(1, max_messages)
        self._max_bytes = max_bytes
        self._drops_first = False
        self._sending: deque[memoryview] = deque()
        self._waiting: deque[list[memoryview]] = deque()
        self._waiting_bytes = 0
        self._rest = _Rest.NONE

    def bound(self, max_messages: int, max_bytes: int, drops_first: bool = False) -> None:
        """Sets the queue limits. One message may always wait.

        Args:
            max_messages: maximum number of messages.
            max_bytes: maximum size of these messages together.
            drops_first: never report `is_full`: drop the oldest messages instead of slowing the source down.
        """
        self._max_messages = max(1, max_messages)
        self._max_bytes = max_bytes
        self._drops_first = drops_first

    @property
    def is_empty(self) -> bool:
        """Whether nothing waits to be sent."""
        return not self._sending and not self._waiting

    @property
    def is_full(self) -> bool:
        """Whether the receiver is behind, so that the source should pause."""
        return bool(self._sending or self._waiting) and not self._drops_first

    @property
    def is_between(self) -> bool:
        """Whether the queue ends at a frame boundary, so that `insert` is allowed."""
        return self._rest is _Rest.NONE or self._rest is _Rest.SKIP

    @property
    def is_direct(self) -> bool:
        """Whether newly arriving data may be sent at once and completely."""
        return self._rest is not _Rest.SKIP and self.is_empty

    @property
    def size(self) -> int:
        """Bytes in the queue."""
        return self._waiting_bytes + sum(map(len, self._sending))

    def begin(self, partial: memoryview | None, in_frame: bool) -> None:
        """Joins a running stream.

        Args:
            partial: the bytes received so far of the arriving frame, if known.
            in_frame: whether the stream is within a frame. Without `partial`, that frame is skipped.
        """
        if partial is not None and in_frame:
            self._waiting.append([partial])
            self._waiting_bytes += len(partial)
            self._rest = _Rest.HOLD
        else:
            self._rest = _Rest.SKIP if in_frame else _Rest.NONE

    def direct(self, chunk: Chunk) -> memoryview | None:
        """Returns the bytes that may be sent at once, without queueing, or None if the queue is not empty.

        The owner reports with `sent` how many were sent; the bytes are valid only until then.
        """
        if self._sending or self._waiting:
            return None
        return chunk.data[chunk.head :] if self._rest is _Rest.SKIP else chunk.data

    def sent(self, chunk: Chunk, count: int) -> None:
        """Queues the rest of a chunk after `count` of the bytes returned by `direct` were sent."""
        offset = count + (chunk.head if self._rest is _Rest.SKIP else 0)
        if offset < len(chunk.data):
            self._queue_from(chunk, offset)
        elif chunk.tail < len(chunk.data):
            self._rest = _Rest.SEND
        elif chunk.head_ends:
            self._rest = _Rest.NONE
        elif self._rest is not _Rest.SKIP:
            self._rest = _Rest.SEND

    def passed(self, ended: bool) -> None:
        """Records that bytes of the arriving frame were sent while `is_direct`; `ended` if its last byte was too."""
        self._rest = _Rest.NONE if ended else _Rest.SEND

    def queue(self, chunk: Chunk) -> None:
        """Appends a whole chunk to the queue."""
        if chunk.head:
            head = chunk.stable[: chunk.head]
            if self._rest is _Rest.SEND:
                self._sending.append(head)
            elif self._rest is _Rest.HOLD:
                self._waiting[-1].append(head)
                self._waiting_bytes += len(head)
        if chunk.head_ends:
            self._rest = _Rest.NONE
            self._queue_frames(chunk, chunk.head)
        self._trim()

    def insert(self, data: bytes) -> None:
        """Appends bytes that are not a frame. They and everything queued before them are never dropped.

        Only allowed between two frames, see `abandon`.
        """
        self._commit(self._waiting_bytes)
        self._sending.append(memoryview(data))

    def abandon(self) -> bool:
        """Discards the incomplete frame, whose end will never arrive; returns False if its beginning was sent."""
        if self._rest is _Rest.SEND:
            return False
        if self._rest is _Rest.HOLD:
            self._waiting_bytes -= sum(map(len, self._waiting.pop()))
            self.drops += 1
        self._rest = _Rest.NONE
        return True

    def batch(self) -> list[memoryview]:
        """Returns the buffers to send next; empty if nothing is queued."""
        if not self._sending:
            self._commit(BATCH)
        return list(islice(self._sending, MAX_BUFFERS))

    def advance(self, count: int) -> None:
        """Removes the first `count` bytes of what `batch` returned, after they were sent."""
        sending = self._sending
        while count:
            size = len(sending[0])
            if size > count:
                sending[0] = sending[0][count:]
                return
            count -= size
            sending.popleft()

    def frames(self) -> Iterator[memoryview]:
        """Removes and yields all whole frames, for a receiver that takes messages instead of bytes."""
        while self._sending:
            yield self._sending.popleft()
        while len(self._waiting) > (self._rest is _Rest.HOLD):
            parts = self._waiting.popleft()
            self._waiting_bytes -= sum(map(len, parts))
            yield parts[0] if len(parts) == 1 else memoryview(b"".join(parts))

    def _commit(self, size: int) -> None:
        while self._waiting and size > 0:
            parts = self._waiting.popleft()
            length = sum(map(len, parts))
            self._sending.extend(parts)
            self._waiting_bytes -= length
            size -= length
            if self._rest is _Rest.HOLD and not self._waiting:
                self._rest = _Rest.SEND

    def _queue_from(self, chunk: Chunk, offset: int) -> None:
        if offset < chunk.head:
            self._sending.append(chunk.stable[offset : chunk.head])
            self._rest = _Rest.NONE if chunk.head_ends else _Rest.SEND
            position = chunk.head
        else:
            self._rest = _Rest.NONE
            position = self._finish_frame(chunk, offset)
        self._queue_frames(chunk, position)
        self._trim()

    def _finish_frame(self, chunk: Chunk, offset: int) -> int:
        """Queues the rest of the frame that was sent up to `offset`; returns where the next frame begins."""
        for start, stop in chunk.frames():
            if start == offset:
                return offset
            if offset < stop:
                self._sending.append(chunk.stable[offset:stop])
                return stop
        if offset > chunk.tail:
            self._sending.append(chunk.stable[offset:])
            self._rest = _Rest.SEND
            return len(chunk.data)
        return offset

    def _queue_frames(self, chunk: Chunk, position: int) -> None:
        stable, end = chunk.stable, len(chunk.data)
        for start, stop in chunk.frames():
            if start >= position:
                self._waiting.append([stable[start:stop]])
        if position <= chunk.tail < end:
            self._waiting.append([stable[chunk.tail :]])
            self._rest = _Rest.HOLD
        if position < end:
            self._waiting_bytes += end - position

    def _trim(self) -> None:
        waiting = self._waiting
        while len(waiting) > 1 and (
            len(waiting) > self._max_messages or self._waiting_bytes > self._max_bytes
        ):
            self._waiting_bytes -= sum(map(len, waiting.popleft()))
            self.drops += 1
