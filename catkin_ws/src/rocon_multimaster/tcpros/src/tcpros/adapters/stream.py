"""A non-blocking TCP connection in the reactor that sends and receives. Received data is parsed in place."""

import math
import socket
from collections.abc import Callable

from tcpros.adapters.brake import Brake
from tcpros.adapters.channel import Channel
from tcpros.adapters.reactor import Reactor
from tcpros.adapters.tls_socket import TlsSocket
from tcpros.core.error import TcprosError
from tcpros.core.fanout import Fanout, Passage
from tcpros.core.frame import LENGTH_SIZE

Parse = Callable[[memoryview], int]
"""Parses received data and returns how many bytes it has consumed. Raises TcprosError for malformed data."""


class Stream(Channel):
    """One connection. Subclasses set `parse`."""

    longest_hold = math.inf  #: the longest pause in reading caused by back-pressure [s]

    def __init__(self, reactor: Reactor, sock: socket.socket, peer: str, tls: TlsSocket | None = None) -> None:
        self.parse: Parse = len  #: called with the received data, repeatedly while it consumes some and more is left
        #: receives the frames from `parse`, once set. Large messages may bypass `parse`. Reading pauses while the
        #: fanout is full, so back-pressure propagates to the source.
        self.fanout: Fanout | None = None
        self._kept = b""
        self._held = False
        self._brake: Brake | None = None
        super().__init__(reactor, sock, peer, tls)

    @property
    def is_reading(self) -> bool:
        """Whether reading is neither held nor paused by the brake."""
        return not (self._held or (self._brake is not None and self._brake.is_on))

    def hold(self) -> None:
        """Stops reading until `release`."""
        self._held = True
        self.update_events()

    def release(self) -> None:
        """Resumes reading."""
        if self._held:
            self._held = False
            self.update_events()

    def read_on(self) -> None:
        """Resumes reading, starting with the data that had arrived before `hold` and was not consumed."""
        self.release()
        kept, self._kept = self._kept, b""
        self._parse_all(memoryview(kept))

    def finish(self, data: bytes) -> None:
        """Sends the last bytes and closes once they are sent; further received data is ignored."""
        self.parse = len
        super().finish(data)

    def close(self, reason: str) -> None:
        """Ends the connection; a second call does nothing."""
        if self._brake is not None and not self.is_closed:
            self._brake.cancel()
        super().close(reason)

    def readable(self) -> None:
        """Reads once. A large message for a single receiver is spliced from socket to socket."""
        passage = self._passage()
        if passage is None:
            self._read(len(self._reactor.buffer))
        elif passage.remaining:
            self._splice(passage)
        else:
            self._read(LENGTH_SIZE)
            passage = self._passage()
            if passage is not None and passage.remaining:
                self._splice(passage)
        if self.fanout is not None and self.fanout.is_full:
            self._hold_back(self.fanout)

    def _passage(self) -> Passage | None:
        if self.fanout is None or self.is_closed or self._tls is not None or not self._reactor.pipe.is_usable:
            return None
        return self.fanout.passage()

    def _splice(self, passage: Passage) -> None:
        assert self.fanout is not None
        try:
            moved = self._reactor.pipe.move(self._socket.fileno(), passage.sink.fileno(), passage.remaining)
        except OSError as error:
            self._failed(error)
            return
        self._reactor.moved += moved.taken + len(moved.rest)
        if moved.taken:
            self.fanout.passed(moved.taken)
        if moved.rest:
            self.fanout.feed(memoryview(moved.rest))
        elif not moved.taken:
            self.close("")

    def _read(self, size: int) -> None:
        buffer, kept = self._reactor.buffer, len(self._kept)
        if kept:
            buffer[:kept] = self._kept
        try:
            count = self._wire.recv_into(buffer[kept : size if size > kept else len(buffer)])
        except OSError as error:
            self._failed(error)
            return
        if not count:
            self.close("")
            return
        if self.fanout is not None:
            self._reactor.moved += count
        self._kept = b""
        self._parse_all(buffer[: kept + count])

    def _failed(self, error: OSError) -> None:
        if not isinstance(error, BlockingIOError):
            self.close(error.strerror or str(error))

    def _parse_all(self, data: memoryview) -> None:
        try:
            while data and not self.is_closed and (done := self.parse(data)):
                data = data[done:]
        except TcprosError as error:
            self.close(f"malformed: {error}")
        if self.is_closed:
            return
        if len(data) >= len(self._reactor.buffer) // 2 and not self._held:
            self.close("malformed: too much without an end")
        else:
            self._kept = bytes(data)

    def _hold_back(self, fanout: Fanout) -> None:
        if self.is_closed:
            return
        if self._brake is None:
            self._brake = Brake(self._reactor, fanout, self.longest_hold, self.update_events)
        self._brake.apply()
        self.update_events()
