"""A non-blocking TCP connection in the reactor. Received data is parsed in place."""

import math
import os
import select
import socket
import struct
from collections.abc import Callable
from typing import NamedTuple

from tcpros.backlog import Backlog
from tcpros.brake import Brake
from tcpros.error import TcprosError
from tcpros.fanout import Fanout, Outlet, Passage, do_nothing
from tcpros.frame import LENGTH_SIZE, MAX_MESSAGE, Chunk
from tcpros.reactor import BUFFER_SIZE, Reactor
from tcpros.tls_socket import NoTlsError, TlsSocket

_IN, _OUT = select.EPOLLIN, select.EPOLLOUT
_FAILED = select.EPOLLERR | select.EPOLLHUP
_ACKED = struct.Struct("=120xQ")  # the beginning of Linux's tcp_info, up to tcpi_bytes_acked
_RECEIVED = struct.Struct("=128xQ")  # the same, up to tcpi_bytes_received
_LENGTH = struct.Struct("<I")

LARGE_MESSAGE = BUFFER_SIZE // 4
"""Longer messages are collected in a buffer of their own [bytes]."""

Parse = Callable[[memoryview], int]
"""Parses received data and returns how many bytes it has consumed. Raises TcprosError for malformed data."""


class _Collected(NamedTuple):
    """Data that is gathered by `Stream.collect`."""

    data: bytearray  #: what has arrived of it
    size: int  #: its size [bytes]
    take: Callable[[memoryview], object]  #: called with all of it


class Stream(Outlet):
    """One connection: a receiver that is its own `Pressure`.

    Subclasses set `parse`, and may override `connected`, `without_tls`, `closed` and `left`.

    Args:
        reactor: the loop.
        sock: the connection.
        peer: the other end, for log lines.
        tls: encrypts the connection; None for plain TCP.
    """

    longest_hold = math.inf  #: the longest pause in reading caused by back-pressure [s]

    def __init__(
        self, reactor: Reactor, sock: socket.socket, peer: str, tls: TlsSocket | None = None
    ) -> None:
        self.backlog = Backlog(1, 0)  #: queued data
        self.pressure = self
        self.peer = peer  #: the other end, for log lines
        self.relieved: Callable[[], None] = (
            do_nothing  #: called when the queue has been sent completely
        )
        self.parse: Parse = len  #: called with the received data, repeatedly while it consumes some and more is left
        #: receives the frames from `parse`, once set. Large messages may bypass `parse`. Reading pauses while the
        #: fanout is full, so back-pressure propagates to the source.
        self.fanout: Fanout | None = None
        self.is_closed = False  #: whether `close` was called
        self._reactor = reactor
        self._socket = sock
        self._tls = tls
        self._wire: socket.socket | TlsSocket = tls or sock
        self._connecting = False
        self._shaking = tls is not None
        self._finishing = False
        self._kept = b""
        self._collected: _Collected | None = None
        self._held = False
        self._brake: Brake | None = None
        self._events = _IN
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        reactor.add(sock.fileno(), self, _IN)

    @property
    def takes_directly(self) -> bool:
        """Whether it is not encrypted."""
        return self._tls is None

    @property
    def is_full(self) -> bool:
        """Whether the peer is behind."""
        return self.backlog.is_full

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

    def collect(self, size: int, take: Callable[[memoryview], object]) -> None:
        """Gathers the next bytes in a buffer of their own, for data that the loop's buffer cannot hold.

        Called by `parse`, which continues with the data behind these bytes.

        Args:
            size: how many bytes, at least 1. Memory grows with the bytes that have arrived.
            take: called once with all of them.
        """
        self._collected = _Collected(bytearray(), size, take)

    def connect(self, host: str, port: int) -> None:
        """Starts connecting to a numeric address; `connected` or `closed` is called later."""
        self._connecting = True
        self._watch(_OUT)
        try:
            self._socket.connect((host, port))
        except BlockingIOError:
            pass
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            self._reactor.call(lambda: self.close(reason))

    def connected(self) -> None:
        """Called once the connection is established, including TLS. Not called for accepted plain connections."""

    def without_tls(self) -> None:
        """Called when the peer does not speak TLS although it should. The connection is plain TCP by then."""
        self.close(NoTlsError().strerror)

    def closed(self, reason: str) -> None:
        """Called once, after the connection has ended for any reason."""

    def ready(self, events: int) -> None:
        """Handles epoll events."""
        if self._connecting:
            self._finish_connecting()
            return
        if self._shaking:
            self._shake_hands()
            return
        if events & _OUT:
            self.flush()
        if events & (_IN | _FAILED) and not self.is_closed:
            self._receive()

    def push(self, chunk: Chunk) -> None:
        """Sends or queues a chunk."""
        direct = self.backlog.direct(chunk)
        if direct is None:
            self.backlog.queue(chunk)
            return
        # The kernel may hold back the start of a message until more arrives, unless that delays another message's end.
        flags = socket.MSG_MORE if chunk.is_open and not chunk.ended else 0
        try:
            count = self._wire.send(direct, flags) if direct else 0
        except OSError as error:
            self._failed(error)
            count = 0
        self.backlog.sent(chunk, count)
        self.update_events()

    def fileno(self) -> int:
        """Returns the socket's descriptor."""
        return self._socket.fileno()

    def passed(self, count: int, ended: bool) -> None:
        """Records bytes of one message that were written directly to `fileno`."""
        self.backlog.passed(ended)

    def acknowledged(self) -> int:
        """Returns how many bytes the peer has acknowledged."""
        return self._tcp_info(_ACKED)

    def received(self) -> int:
        """Returns how many bytes have arrived from the peer, read or not."""
        return self._tcp_info(_RECEIVED)

    def send(self, data: bytes) -> None:
        """Queues bytes behind all waiting data and sends what it can. These bytes are never dropped."""
        if data:
            self.backlog.insert(data)
        self.flush()

    def pass_on(self, data: memoryview) -> None:
        """Like `send`, but the caller may change `data` after the call."""
        sent = 0
        if self.backlog.is_empty:
            try:
                sent = self._wire.send(data)
            except OSError as error:
                self._failed(error)
        if sent < len(data):
            self.backlog.insert(bytes(data[sent:]))
        self.update_events()

    def finish(self, data: bytes) -> None:
        """Sends the last bytes and closes once they are sent; further received data is ignored."""
        self.parse = len
        self._collected = None
        self._finishing = True
        self.send(data)

    def flush(self) -> None:
        """Sends queued data until the socket would block."""
        if self.is_closed or self._connecting or self._shaking:
            return
        try:
            if self._tls is not None:
                self._tls.flush()
            while buffers := self.backlog.batch():
                self.backlog.advance(self._wire.sendmsg(buffers))
        except OSError as error:
            self._failed(error)
        if self._finishing and self._is_sent:
            self.close("")
        else:
            self.update_events()

    def close(self, reason: str) -> None:
        """Ends the connection; a second call does nothing."""
        if self.is_closed:
            return
        self.is_closed = True
        if self._brake is not None:
            self._brake.cancel()
        self._reactor.remove(self._socket.fileno())
        if self._tls is not None:
            self._tls.close()
        self._socket.close()
        self.closed(reason)

    def update_events(self) -> None:
        """Updates the epoll mask to the events needed now."""
        if self.is_closed or self._connecting or self._shaking:
            return
        reading = _IN if self.is_reading else 0
        if self._is_sent:
            was_behind = self._events & _OUT
            self._watch(reading)
            if was_behind:
                self.relieved()
        else:
            self._watch(reading | _OUT)

    def _receive(self) -> None:
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
        if (
            self.fanout is None
            or self.is_closed
            or self._tls is not None
            or not self._reactor.pipe.is_usable
        ):
            return None
        return self.fanout.passage()

    def _splice(self, passage: Passage) -> None:
        assert self.fanout is not None
        try:
            moved = self._reactor.pipe.move(
                self._socket.fileno(), passage.sink.fileno(), passage.remaining
            )
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
        """Closes the connection after an error of its socket, unless the call would only have blocked."""
        if not isinstance(error, BlockingIOError):
            self.close(error.strerror or str(error))

    def _parse_all(self, data: memoryview) -> None:
        try:
            while data and not self.is_closed:
                done = self.parse(data) if self._collected is None else self._gather(data)
                if not done:
                    break
                data = data[done:]
        except TcprosError as error:
            self.close(f"malformed: {error}")
        if self.is_closed:
            return
        if len(data) >= len(self._reactor.buffer) // 2 and not self._held:
            self.close("malformed: too much without an end")
        else:
            self._kept = bytes(data)

    def _gather(self, data: memoryview) -> int:
        """Takes what belongs to the data that is collected; returns how much that was."""
        collected = self._collected
        assert collected is not None
        part = data[: collected.size - len(collected.data)]
        collected.data.extend(part)
        if len(collected.data) == collected.size:
            self._collected = None
            collected.take(memoryview(collected.data))
        return len(part)

    def _hold_back(self, fanout: Fanout) -> None:
        if self.is_closed:
            return
        if self._brake is None:
            self._brake = Brake(self._reactor, fanout, self.longest_hold, self.update_events)
        self._brake.apply()
        self.update_events()

    def _finish_connecting(self) -> None:
        error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if error:
            self.close(os.strerror(error))
            return
        self._connecting = False
        if self._shaking:
            self._shake_hands()
        else:
            self._established()

    def _shake_hands(self) -> None:
        assert self._tls is not None
        try:
            self._shaking = not self._tls.shake_hands()
        except NoTlsError:
            self._shaking, self._tls, self._wire = False, None, self._socket
            self.without_tls()
            return
        except OSError as error:
            self._failed(error)
            return
        if self._shaking:
            self._watch(_IN | _OUT if self._tls.has_unsent else _IN)
            return
        self._established()
        if not self.is_closed:
            self._receive()  # data may have arrived together with the end of the handshake

    def _established(self) -> None:
        self.update_events()
        self.connected()
        self.flush()

    @property
    def _is_sent(self) -> bool:
        return self.backlog.is_empty and (self._tls is None or not self._tls.has_unsent)

    def _tcp_info(self, layout: struct.Struct) -> int:
        information = self._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, layout.size)
        return int(layout.unpack(information)[0]) if len(information) == layout.size else 0

    def _watch(self, events: int) -> None:
        if events != self._events:
            self._events = events
            self._reactor.change(self._socket.fileno(), events)


def message_parser(stream: Stream, take: Callable[[memoryview], object]) -> Parse:
    """Returns a parser for messages of any size up to `MAX_MESSAGE`, each behind its 32-bit length.

    The next message is taken once the stream is reading; `take` may hold it.

    Args:
        stream: the stream that the parser is for.
        take: called with each message without its length. The data is valid only during the call.
    """

    def parse(data: memoryview) -> int:
        if len(data) < LENGTH_SIZE or not stream.is_reading:
            return 0
        length = int(_LENGTH.unpack_from(data)[0])
        if length > MAX_MESSAGE:
            raise TcprosError(f"a message of {length} bytes, above {MAX_MESSAGE}")
        end = LENGTH_SIZE + length
        if end <= len(data):
            take(data[LENGTH_SIZE:end])
            return end
        if length > LARGE_MESSAGE:
            stream.collect(length, take)
            return LENGTH_SIZE
        return 0

    return parse
