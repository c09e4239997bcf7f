"""What waits for one receiver: bounded, whole messages, the oldest dropped first.

No socket here: the owner asks what may be sent and says how much of it was. What has begun to go out always
goes out whole, so the receiver never loses its place in the stream.
"""

import enum
import sys
from collections import deque
from collections.abc import Iterator
from itertools import islice

from tcpros.core.frame import Chunk

BATCH = 64 * 1024
"""So many bytes, and the rest of one message, leave the reach of dropping before they are sent."""

UNBOUNDED = sys.maxsize
"""Stands for a bound that nothing reaches."""

MAX_BUFFERS = 512
"""So many buffers at most go into one system call (Linux allows 1024)."""


class _Rest(enum.Enum):
    """What becomes of the rest of the frame that is arriving."""

    NONE = enum.auto()  # between two frames
    SEND = enum.auto()  # its beginning went out or will
    HOLD = enum.auto()  # its beginning waits as the last message, and may be dropped
    SKIP = enum.auto()  # its beginning was missed


class Backlog:
    """The bytes between a stream of frames and one receiver."""

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
        """Sets how many messages, and of how many bytes, may wait at most; one message always may.

        Args:
            max_messages: so many.
            max_bytes: their bytes.
            drops_first: drop the oldest beyond that instead of having their source wait, as `is_full` does.
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
        """Whether its receiver is behind, so that it is better to wait than to bring more."""
        return bool(self._sending or self._waiting) and not self._drops_first

    @property
    def is_between(self) -> bool:
        """Whether the receiver would be between two frames once it has all that waits, so that `insert` is allowed."""
        return self._rest is _Rest.NONE or self._rest is _Rest.SKIP

    @property
    def is_direct(self) -> bool:
        """Whether whatever arrives now may be sent at once, all of it."""
        return self._rest is not _Rest.SKIP and self.is_empty

    @property
    def size(self) -> int:
        """Bytes that wait."""
        return self._waiting_bytes + sum(map(len, self._sending))

    def begin(self, partial: memoryview | None, in_frame: bool) -> None:
        """Joins a stream that runs.

        Args:
            partial: the bytes so far of the frame that is arriving, if they are known.
            in_frame: whether the stream is within a frame; without `partial` this one is left out.
        """
        if partial is not None and in_frame:
            self._waiting.append([partial])
            self._waiting_bytes += len(partial)
            self._rest = _Rest.HOLD
        else:
            self._rest = _Rest.SKIP if in_frame else _Rest.NONE

    def direct(self, chunk: Chunk) -> memoryview | None:
        """Returns what may be sent at once, unqueued, or None where something waits before it.

        The owner tells by `sent` how much of it was; the bytes are only valid until then.
        """
        if self._sending or self._waiting:
            return None
        return chunk.data[chunk.head :] if self._rest is _Rest.SKIP else chunk.data

    def sent(self, chunk: Chunk, count: int) -> None:
        """Takes over the rest of a chunk of which `direct` gave the bytes and `count` of these were sent."""
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
        """Bytes of the frame that is arriving went out while `is_direct`; `ended`: its last one as well."""
        self._rest = _Rest.NONE if ended else _Rest.SEND

    def queue(self, chunk: Chunk) -> None:
        """Takes a chunk whole, behind what waits."""
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
        """Puts bytes that are no frame behind everything that waits; these and all before are never dropped.

        Only between two frames: see `abandon`.
        """
        self._commit(self._waiting_bytes)
        self._sending.append(memoryview(data))

    def abandon(self) -> bool:
        """Forgets the frame that is arriving, whose end will never come; False if its beginning has gone out."""
        if self._rest is _Rest.SEND:
            return False
        if self._rest is _Rest.HOLD:
            self._waiting_bytes -= sum(map(len, self._waiting.pop()))
            self.drops += 1
        self._rest = _Rest.NONE
        return True

    def batch(self) -> list[memoryview]:
        """Returns buffers to send next, none if nothing waits."""
        if not self._sending:
            self._commit(BATCH)
        return list(islice(self._sending, MAX_BUFFERS))

    def advance(self, count: int) -> None:
        """Forgets the first `count` bytes of what `batch` returned: they were sent."""
        sending = self._sending
        while count:
            size = len(sending[0])
            if size > count:
                sending[0] = sending[0][count:]
                return
            count -= size
            sending.popleft()

    def frames(self) -> Iterator[memoryview]:
        """Takes out all whole frames, for a receiver of messages. Nothing of it went out otherwise."""
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
        """Keeps the rest of the frame of which the bytes before `offset` went out; returns where the next begins."""
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
        while len(waiting) > 1 and (len(waiting) > self._max_messages or self._waiting_bytes > self._max_bytes):
            self._waiting_bytes -= sum(map(len, waiting.popleft()))
            self.drops += 1
