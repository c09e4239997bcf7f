"""Distributes one stream of frames to any number of receivers; keeps the latched messages for new ones."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

from tcpros.backlog import Backlog
from tcpros.frame import Chunk, FrameSplitter


class Pressure(Protocol):
    """The load of a receiver, for back-pressure."""

    relieved: Callable[
        [], None
    ]  #: set by the source; called when the receiver takes more again after it was full

    @property
    def is_full(self) -> bool:
        """Whether it is behind, so that its source should pause."""

    def acknowledged(self) -> int:
        """Returns how many bytes were taken so far. This distinguishes a slow receiver from a stalled one."""


class Outlet:
    """A receiver of frames. Subclasses override `push`, and the rest as they need it."""

    backlog: Backlog  #: its send queue
    pressure: Pressure  #: its load

    @property
    def takes_directly(self) -> bool:
        """Whether large messages may be written to `fileno` instead, as `Fanout.passage` allows."""
        return False

    def push(self, chunk: Chunk) -> None:
        """Sends or queues a chunk."""
        raise NotImplementedError

    def fileno(self) -> int:
        """Returns the descriptor for large messages, if it `takes_directly`."""
        raise NotImplementedError

    def passed(self, count: int, ended: bool) -> None:
        """Records that bytes of the arriving frame, and its end if `ended`, were written to the descriptor."""

    def flush(self) -> None:
        """Sends queued data as far as the receiver takes it."""

    def left(self) -> None:
        """Called when the frame being sent at the time of `Fanout.leave` is complete."""

    def close(self, reason: str) -> None:
        """Ends the connection."""


class Passage(NamedTuple):
    """A direct path to the receiver that bypasses `Fanout.feed`."""

    sink: Outlet  #: the receiver
    remaining: int  #: missing bytes of the arriving message; 0 between messages, when the next length must be read


class Latch:
    """Keeps what new receivers of a latched topic get first: the last message. Subclasses may keep more."""

    def __init__(self) -> None:
        self._last: memoryview | None = None

    def keep(self, frame: memoryview) -> None:
        """Takes a new message, as a frame that never changes."""
        self._last = frame

    @property
    def frames(self) -> list[memoryview]:
        """The kept messages, oldest first."""
        return [] if self._last is None else [self._last]


class Fanout:
    """Forwards frames as they arrive, in the pieces in which they were read."""

    def __init__(self, max_message_size: int) -> None:
        self.messages = 0  #: whole messages received
        self.bytes = 0  #: their bytes, including length prefixes
        self.latching = False  #: whether the source's messages are kept for new receivers
        self.relieved: Callable[[], None] = (
            do_nothing  #: called when a receiver takes more again after `is_full`
        )
        self._max_message_size = max_message_size
        self._splitter = FrameSplitter(max_message_size)
        self._outlets: list[Outlet] = []
        self._leaving: list[Outlet] = []
        self._latch = Latch()
        self._partial: list[memoryview] = []

    def __len__(self) -> int:
        return len(self._outlets) + len(self._leaving)

    @property
    def is_full(self) -> bool:
        """Whether there are receivers and all of them are behind. The fastest receiver sets the pace."""
        for outlet in self._outlets:
            if not outlet.pressure.is_full:
                return False
        return bool(self._outlets) and not self._leaving

    def acknowledged(self) -> int:
        """Returns how many bytes all receivers together have taken."""
        return sum(outlet.pressure.acknowledged() for outlet in self._outlets)

    def feed(self, data: memoryview) -> int:
        """Forwards received data and returns how many bytes were consumed.

        Pass the rest again at the start of the next data, unless it is a control frame.

        Raises:
            FrameError: a message is longer than allowed.
        """
        chunk = self._splitter.split(data)
        size = len(chunk.data)
        if size:
            self.messages += chunk.ended
            self.bytes += size
            if self.latching:
                self._keep(chunk)
            for outlet in tuple(self._outlets):
                outlet.push(chunk)
            if self._leaving:
                self._finish_leaving(chunk)
        return size

    def passage(self) -> Passage | None:
        """Returns the direct path, available for large messages that are not latched and have one idle receiver."""
        if not self._splitter.is_large or self.latching or self._leaving or len(self._outlets) != 1:
            return None
        outlet = self._outlets[0]
        is_open = outlet.takes_directly and outlet.backlog.is_direct
        return Passage(outlet, self._splitter.remaining) if is_open else None

    def passed(self, count: int) -> None:
        """Records bytes of one message that were sent through `passage`."""
        self._splitter.remaining -= count
        ended = not self._splitter.remaining
        self.messages += ended
        self.bytes += count
        self._outlets[0].passed(count, ended)

    def join(self, outlet: Outlet) -> None:
        """Adds a receiver. On a latched topic, it first gets the kept messages."""
        for frame in self._latch.frames:
            outlet.backlog.insert(frame.tobytes())
        partial = memoryview(b"".join(self._partial)) if self._partial else None
        outlet.backlog.begin(partial, self._splitter.remaining > 0)
        self._outlets.append(outlet)
        outlet.pressure.relieved = self._relieve
        outlet.flush()
        self._relieve()

    def remove(self, outlet: Outlet) -> None:
        """Removes a receiver whose connection has ended; ignores an unknown one."""
        for outlets in (self._outlets, self._leaving):
            if outlet in outlets:
                outlets.remove(outlet)
        self._relieve()

    def leave(self, outlet: Outlet) -> None:
        """Removes a receiver that stays connected; calls its `left` once the current frame has been sent to it."""
        if outlet in self._outlets:
            self._outlets.remove(outlet)
            gone = outlet.backlog.abandon()
            if not gone:
                self._leaving.append(outlet)
            self._relieve()
            if not gone:
                return
        outlet.left()

    def begin(self, latching: bool, latch: Latch | None = None) -> None:
        """Prepares for a new source, between two frames; discards the latched messages of the old one.

        Args:
            latching: whether the source latches.
            latch: keeps its messages; None for the last message.
        """
        self.latching = latching
        self._latch = latch or Latch()

    def restart(self) -> None:
        """Resets the stream after its source has ended. Receivers that got part of a message are closed."""
        self._splitter = FrameSplitter(self._max_message_size)
        self._latch = Latch()
        self._partial.clear()
        for outlet in (*self._outlets, *self._leaving):
            if not outlet.backlog.abandon():
                outlet.close("its source ended within a message")

    def _relieve(self) -> None:
        if not self.is_full:
            self.relieved()

    def _finish_leaving(self, chunk: Chunk) -> None:
        last = Chunk(
            chunk.data[: chunk.head], chunk.head, chunk.head_ends, chunk.head, int(chunk.head_ends)
        )
        for outlet in tuple(self._leaving):
            outlet.push(last)
            if last.head_ends and outlet in self._leaving:
                self._leaving.remove(outlet)
                outlet.left()

    def _keep(self, chunk: Chunk) -> None:
        if chunk.head:
            self._partial.append(chunk.stable[: chunk.head])
        if not chunk.head_ends:
            return
        if chunk.head:
            self._latch.keep(memoryview(b"".join(self._partial)))
            self._partial.clear()
        for start, stop in chunk.frames():
            self._latch.keep(chunk.stable[start:stop])
        if chunk.tail < len(chunk.data):
            self._partial.append(chunk.stable[chunk.tail :])


def do_nothing() -> None:
    """The default callback."""
