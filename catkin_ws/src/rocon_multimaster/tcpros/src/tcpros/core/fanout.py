"""One stream of frames in, any number of receivers out, and what a latched topic owes to newcomers."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

from tcpros.core.backlog import Backlog
from tcpros.core.frame import Chunk, FrameSplitter


class Pressure(Protocol):
    """How far behind something is that takes messages."""

    relieved: Callable[[], None]  #: to be called when it takes more again after it was full; the source sets it

    @property
    def is_full(self) -> bool:
        """Whether it is behind, so that its source had better wait."""

    def acknowledged(self) -> int:
        """Returns how many bytes were taken so far: this tells a slow receiver from one that has stopped."""


class DirectSink(Protocol):
    """A descriptor to which large messages may be written without `Outlet.push`."""

    def fileno(self) -> int:
        """Returns the descriptor."""

    def passed(self, count: int, ended: bool) -> None:
        """Records that bytes of the arriving frame, and its end if `ended`, were written to the descriptor."""


class Outlet(Protocol):
    """A receiver of frames."""

    backlog: Backlog  #: what waits for it

    @property
    def pressure(self) -> Pressure:
        """How far behind it is."""

    @property
    def direct(self) -> DirectSink | None:
        """Where large messages may go as `Fanout.passage` allows; None if everything has to be pushed."""

    def push(self, chunk: Chunk) -> None:
        """Sends or queues a chunk."""

    def flush(self) -> None:
        """Sends what waits, as far as the receiver takes it."""

    def left(self) -> None:
        """Called when the frame that was under way at `Fanout.leave` has been sent whole."""

    def close(self, reason: str) -> None:
        """Ends the connection."""


class Passage(NamedTuple):
    """A way on which messages bypass `Fanout.feed`."""

    sink: DirectSink  #: the receiver
    remaining: int  #: bytes to come of the arriving message; 0 between two, where the next length has to be read


class Fanout:
    """Passes frames on as they come, cut where the reads cut them."""

    def __init__(self, max_message_size: int) -> None:
        self.messages = 0  #: whole messages that came in
        self.bytes = 0  #: their bytes, lengths included
        self.latching = False  #: whether the source's last message is kept for newcomers
        self.relieved: Callable[[], None] = _nobody_waits  #: is called when somebody takes more again after `is_full`
        self._max_message_size = max_message_size
        self._splitter = FrameSplitter(max_message_size)
        self._outlets: list[Outlet] = []
        self._leaving: list[Outlet] = []
        self._last: memoryview | None = None
        self._partial: list[memoryview] = []

    def __len__(self) -> int:
        return len(self._outlets) + len(self._leaving)

    @property
    def is_full(self) -> bool:
        """Whether there are receivers and all of them are behind: the quickest decides."""
        for outlet in self._outlets:
            if not outlet.pressure.is_full:
                return False
        return bool(self._outlets) and not self._leaving

    def acknowledged(self) -> int:
        """Returns how many bytes all receivers together have taken."""
        return sum(outlet.pressure.acknowledged() for outlet in self._outlets)

    def feed(self, data: memoryview) -> int:
        """Passes on what arrived and returns how many bytes of it are done with.

        The rest is to be given once more at the beginning of the next data, or is a control frame.

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
        """Returns how messages may pass unseen now: large ones, none to be kept, one receiver that is not behind."""
        if not self._splitter.is_large or self.latching or self._leaving or len(self._outlets) != 1:
            return None
        outlet = self._outlets[0]
        sink = outlet.direct if outlet.backlog.is_direct else None
        return Passage(sink, self._splitter.remaining) if sink is not None else None

    def passed(self, count: int) -> None:
        """Takes note of bytes of one message that went where `passage` said."""
        self._splitter.remaining -= count
        ended = not self._splitter.remaining
        self.messages += ended
        self.bytes += count
        sink = self._outlets[0].direct
        assert sink is not None
        sink.passed(count, ended)

    def join(self, outlet: Outlet) -> None:
        """Adds a receiver: of a latched topic it gets the last message first, then whatever comes."""
        if self._last is not None:
            outlet.backlog.insert(self._last.tobytes())
        partial = memoryview(b"".join(self._partial)) if self._partial else None
        outlet.backlog.begin(partial, self._splitter.remaining > 0)
        self._outlets.append(outlet)
        outlet.pressure.relieved = self._relieve
        outlet.flush()
        self._relieve()

    def remove(self, outlet: Outlet) -> None:
        """Removes a receiver whose connection has ended; one that is not there is no error."""
        for outlets in (self._outlets, self._leaving):
            if outlet in outlets:
                outlets.remove(outlet)
        self._relieve()

    def leave(self, outlet: Outlet) -> None:
        """Removes a receiver that stays connected; its `left` is called at the end of the frame under way to it."""
        if outlet in self._outlets:
            self._outlets.remove(outlet)
            gone = outlet.backlog.abandon()
            if not gone:
                self._leaving.append(outlet)
            self._relieve()
            if not gone:
                return
        outlet.left()

    def begin(self, latching: bool) -> None:
        """Expects the messages of a new source, between two frames; forgets the last one of the old."""
        self.latching = latching
        self._last = None

    def restart(self) -> None:
        """Forgets the stream: its source is gone. A receiver to which half a message went is closed."""
        self._splitter = FrameSplitter(self._max_message_size)
        self._last = None
        self._partial.clear()
        for outlet in (*self._outlets, *self._leaving):
            if not outlet.backlog.abandon():
                outlet.close("its source ended within a message")

    def _relieve(self) -> None:
        if not self.is_full:
            self.relieved()

    def _finish_leaving(self, chunk: Chunk) -> None:
        last = Chunk(chunk.data[: chunk.head], chunk.head, chunk.head_ends, chunk.head, int(chunk.head_ends))
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
            self._last = memoryview(b"".join(self._partial))
            self._partial.clear()
        for start, stop in chunk.frames():
            self._last = chunk.stable[start:stop]
        if chunk.tail < len(chunk.data):
            self._partial.append(chunk.stable[chunk.tail :])


def _nobody_waits() -> None:
    """Stands where nobody waits for relief."""
