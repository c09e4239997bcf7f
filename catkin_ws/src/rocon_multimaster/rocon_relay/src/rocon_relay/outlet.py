"""Outlets for whole messages: apply link options (filter, throttle, compress), and decompress at the other end."""

import time
from collections.abc import Iterator

from rocon_relay.option import LinkOptions
from rocon_relay.sieve import (
    TF_TYPES,
    Pace,
    StampPace,
    deflated,
    inflated,
    matching_transforms,
    whole_frame,
)
from tcpros.backlog import UNBOUNDED, Backlog
from tcpros.fanout import Fanout, Outlet
from tcpros.frame import LENGTH_SIZE, Chunk
from tcpros.reactor import Reactor, Timer

QUIET = 0.5
"""After this long, at most twice, without a message of a kind, its last one is sent whatever its stamp [s]."""


class Sieve(Outlet):
    """Applies the options between a publisher's stream and one link; see `core.fanout.Outlet`."""

    def __init__(self, reactor: Reactor, link: Outlet, options: LinkOptions, type_: str) -> None:
        self.backlog = Backlog(UNBOUNDED, UNBOUNDED)  #: the message that is arriving
        self.left_out = 0  #: messages not sent because of the options
        self.saved = 0  #: bytes saved by compression
        self.pressure = link.pressure
        self._reactor = reactor
        self._link = link
        self._keeps = options.keeps_frame() if options.tf_frames and type_ in TF_TYPES else None
        self._pace = Pace(options.rate) if options.rate else None
        self._stamps = StampPace(options.stamp_rate, type_) if options.stamp_rate else None
        self._compress = options.compress
        self._newest: bytes | memoryview | None = None
        self._timer: Timer | None = None
        self._held: dict[bytes, memoryview] = {}
        self._seen: dict[bytes, memoryview] = {}
        self._watch: Timer | None = None

    def push(self, chunk: Chunk) -> None:
        """Takes a chunk and handles each complete message."""
        self.backlog.queue(chunk)
        self.flush()

    def flush(self) -> None:
        """Handles the complete messages."""
        for message in _messages(self.backlog):
            self._take(message)

    def left(self) -> None:
        """Stops sending and lets the link leave."""
        self.end()
        self._link.left()

    def end(self) -> None:
        """Stops sending; discards held messages."""
        self._newest = None
        self._held.clear()
        for timer in (self._timer, self._watch):
            if timer is not None:
                timer.cancel()

    def close(self, reason: str) -> None:
        """Closes the link."""
        self._link.close(reason)

    def _take(self, message: memoryview) -> None:
        if self._stamps is not None:
            kind = self._stamps.kind(message)
            self.left_out += self._held.pop(kind, None) is not None
            if not self._stamps.picks(message, kind):
                self._held[kind] = message
                if self._watch is None:
                    self._watch = self._reactor.call_later(QUIET, self._look_whether_quiet)
                return
        self._pass_on(message)

    def _look_whether_quiet(self) -> None:
        for kind, message in self._seen.items():
            if self._held.get(kind) is message:
                del self._held[kind]
                self._pass_on(message)
        self._seen, self._watch = dict(self._held), None
        if self._held:
            self._watch = self._reactor.call_later(QUIET, self._look_whether_quiet)

    def _pass_on(self, message: memoryview) -> None:
        chosen: bytes | memoryview | None = message
        if self._keeps is not None:
            chosen = matching_transforms(message, self._keeps)
        if chosen is None:
            self.left_out += 1
        elif self._pace is None:
            self._send(chosen)
        else:
            self._send_newest(self._pace, chosen)

    def _send_newest(self, pace: Pace, message: bytes | memoryview) -> None:
        if self._newest is not None:
            self.left_out += 1
            self._newest = message
            return
        wait = pace.wait(time.monotonic())
        if wait:
            self._newest = message
            self._timer = self._reactor.call_later(wait, self._send_waiting)
        else:
            pace.went(time.monotonic())
            self._send(message)

    def _send_waiting(self) -> None:
        message, self._newest = self._newest, None
        if message is not None and self._pace is not None:
            self._pace.went(time.monotonic())
            self._send(message)

    def _send(self, message: bytes | memoryview) -> None:
        if self._compress:
            small = deflated(memoryview(message))
            self.saved += len(message) - len(small)
            message = small
        self._link.push(whole_frame(message))


class Inflater(Outlet):
    """Decompresses the messages of a link and feeds them to a fanout; see `core.fanout.Outlet`."""

    def __init__(self, fanout: Fanout, max_message_size: int) -> None:
        self.backlog = Backlog(UNBOUNDED, UNBOUNDED)  #: the message that is arriving
        self.saved = 0  #: bytes saved by compression
        self.pressure = fanout
        self._fanout = fanout
        self._max_message_size = max_message_size

    def push(self, chunk: Chunk) -> None:
        """Takes a chunk and handles each complete message."""
        self.backlog.queue(chunk)
        for message in _messages(self.backlog):
            whole = inflated(message, self._max_message_size)
            self.saved += len(whole) - len(message)
            self._fanout.feed(whole_frame(whole).data)


def _messages(backlog: Backlog) -> Iterator[memoryview]:
    """Removes the complete messages from a backlog and yields them without length prefix."""
    for frame in backlog.frames():
        yield frame[LENGTH_SIZE:]
