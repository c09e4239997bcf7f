"""A non-blocking TCP connection in the reactor: what arrives is parsed in place, what leaves may wait in a backlog."""

import math
import os
import select
import socket
import struct
from collections.abc import Callable

from tcpros.adapters.brake import Brake
from tcpros.adapters.reactor import Reactor
from tcpros.adapters.resolver import DialError
from tcpros.adapters.tls_socket import NoTlsError, TlsSocket
from tcpros.core.backlog import Backlog
from tcpros.core.error import TcprosError
from tcpros.core.fanout import Fanout, Passage
from tcpros.core.frame import LENGTH_SIZE, Chunk

_IN, _OUT = select.EPOLLIN, select.EPOLLOUT
_ACKED = struct.Struct("=120xQ")  # the beginning of Linux's tcp_info, up to tcpi_bytes_acked
_RECEIVED = struct.Struct("=128xQ")  # likewise, up to tcpi_bytes_received
_FAILED = select.EPOLLERR | select.EPOLLHUP

Parse = Callable[[memoryview], int]
"""Takes what has arrived and returns how many bytes it is done with; raises TcprosError for what is malformed."""


class Stream:
    """One connection.

    Subclasses set `parse` and may override `connected`, `without_tls`, `closed` and `left`.

    Args:
        reactor: the loop.
        sock: the connection.
        peer: the other end, for log lines.
        tls: encrypts what passes; None for nothing.

    Attributes:
        backlog: what waits to be sent.
        peer: the other end, for log lines.
        parse: gets what has arrived, again and again while it takes something and there is more.
        fanout: what `parse` gives frames to, once it does; those that it need not see go round `parse`. Nothing is
            read while it is full: so pressure passes from the slowest part of the way to its beginning.
        takes_unseen: see `core.fanout.Outlet`.
        relieved: likewise; called when all that waited has been sent.
        longest_hold: its peer is left waiting so long at most while it is not read [s].
        is_closed: whether `close` was called.
    """

    takes_unseen = True
    longest_hold = math.inf

    def __init__(self, reactor: Reactor, sock: socket.socket, peer: str, tls: TlsSocket | None = None) -> None:
        self.backlog = Backlog(1, 0)
        self.peer = peer
        self.parse: Parse = len
        self.fanout: Fanout | None = None
        self.relieved: Callable[[], None] = _nobody_waits
        self.is_closed = False
        self._reactor = reactor
        self._socket = sock
        self._tls = tls
        self._wire: socket.socket | TlsSocket = tls or sock
        if tls is not None:
            self.takes_unseen = False
        self._kept = b""
        self._connecting = False
        self._shaking = tls is not None
        self._finishing = False
        self._held = False
        self._events = _IN
        self._brake: Brake | None = None
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        reactor.add(sock.fileno(), self, _IN)

    def connect(self, host: str, port: int) -> None:
        """Dials a numeric address; `connected` or `closed` follows."""
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
        """Called once a connection stands that was dialled or is encrypted."""

    def without_tls(self) -> None:
        """Called where the other side speaks no TLS though it should; from here on neither do we."""
        self.close(NoTlsError().strerror)

    def closed(self, reason: str) -> None:
        """Called once, after the connection has ended for whatever reason."""

    def left(self) -> None:
        """See `core.fanout.Outlet`."""

    def ready(self, events: int) -> None:
        """See `reactor.Handler`."""
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
            if self.fanout is not None and self.fanout.is_full:
                self._hold_back(self.fanout)

    @property
    def is_full(self) -> bool:
        """See `core.fanout.Outlet`."""
        return self.backlog.is_full

    def push(self, chunk: Chunk) -> None:
        """See `core.fanout.Outlet`."""
        direct = self.backlog.direct(chunk)
        if direct is None:
            self.backlog.queue(chunk)
            return
        # The beginning of a message can wait for more of it, in the kernel, if no other message's end waits with it.
        flags = socket.MSG_MORE if chunk.is_open and not chunk.ended else 0
        try:
            count = self._wire.send(direct, flags) if direct else 0
        except BlockingIOError:
            count = 0
        except OSError as error:
            self.close(error.strerror)
            return
        self.backlog.sent(chunk, count)
        self._watch_output()

    def fileno(self) -> int:
        """See `core.fanout.Outlet`."""
        return self._socket.fileno()

    def acknowledged(self) -> int:
        """See `core.fanout.Outlet`."""
        return self._tcp_info(_ACKED)

    def received(self) -> int:
        """Returns how many bytes have arrived from the peer, read or not."""
        return self._tcp_info(_RECEIVED)

    def _tcp_info(self, layout: struct.Struct) -> int:
        information = self._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, layout.size)
        return int(layout.unpack(information)[0]) if len(information) == layout.size else 0

    def passed(self, count: int, ended: bool) -> None:
        """See `core.fanout.Outlet`."""
        self.backlog.passed(ended)

    def send(self, data: bytes) -> None:
        """Sends bytes that are never dropped, after everything that waits."""
        if data:
            self.backlog.insert(data)
        self.flush()

    def pass_on(self, data: memoryview) -> None:
        """Sends bytes that are never dropped and may change after this call, after everything that waits."""
        sent = 0
        if self.backlog.is_empty:
            try:
                sent = self._wire.send(data)
            except BlockingIOError:
                pass
            except OSError as error:
                self.close(error.strerror)
                return
        if sent < len(data):
            self.backlog.insert(bytes(data[sent:]))
        self._watch_output()

    def hold(self) -> None:
        """Reads nothing until `release`."""
        self._held = True
        self._watch_output()

    def release(self) -> None:
        """Reads on."""
        if self._held:
            self._held = False
            self._watch_output()

    def read_on(self) -> None:
        """Reads on, first of all what had come before `hold` and was not taken."""
        self.release()
        kept, self._kept = self._kept, b""
        self._parse_all(memoryview(kept))

    def finish(self, data: bytes) -> None:
        """Sends the last bytes and closes once they are out; what arrives from now on is ignored."""
        self._finishing = True
        self.parse = len
        self.send(data)

    def flush(self) -> None:
        """See `core.fanout.Outlet`."""
        if self.is_closed or self._connecting or self._shaking:
            return
        try:
            if self._tls is not None:
                self._tls.flush()
            while buffers := self.backlog.batch():
                self.backlog.advance(self._wire.sendmsg(buffers))
        except BlockingIOError:
            pass
        except OSError as error:
            self.close(error.strerror)
            return
        if self._finishing and self._is_sent:
            self.close("")
        else:
            self._watch_output()

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

    def _finish_connecting(self) -> None:
        error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if error:
            self.close(os.strerror(error))
            return
        self._connecting = False
        if self._shaking:
            self._shake_hands()
            return
        self._watch_output()
        self.connected()
        self.flush()

    def _shake_hands(self) -> None:
        assert self._tls is not None
        try:
            self._shaking = not self._tls.shake_hands()
        except NoTlsError:
            self._shaking, self._tls, self._wire = False, None, self._socket
            self.without_tls()
            return
        except OSError as error:
            self.close(error.strerror)
            return
        if self._shaking:
            self._watch(_IN | _OUT if self._tls.has_unsent else _IN)
            return
        self._watch_output()
        self.connected()
        self.flush()
        if not self.is_closed:
            self._receive()  # there may be more in what brought the handshake's end

    @property
    def _is_sent(self) -> bool:
        return self.backlog.is_empty and (self._tls is None or not self._tls.has_unsent)

    def _receive(self) -> None:
        passage = self._passage()
        if passage is None:
            self._read(len(self._reactor.buffer))
        elif passage.remaining:
            self._pass_on(passage)
        else:
            self._read(LENGTH_SIZE)
            passage = self._passage()
            if passage is not None and passage.remaining:
                self._pass_on(passage)

    def _passage(self) -> Passage | None:
        if self.fanout is None or self.is_closed or self._tls is not None or not self._reactor.pipe.is_usable:
            return None
        return self.fanout.passage()

    def _pass_on(self, passage: Passage) -> None:
        assert self.fanout is not None
        try:
            moved = self._reactor.pipe.move(self._socket.fileno(), passage.outlet.fileno(), passage.remaining)
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
            self.close(error.strerror)

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
            self._brake = Brake(self._reactor, fanout, self.longest_hold, self._watch_output)
        self._brake.apply()
        self._watch_output()

    def _watch_output(self) -> None:
        if self.is_closed or self._connecting or self._shaking:
            return
        reading = 0 if self._held or (self._brake is not None and self._brake.is_on) else _IN
        if self._is_sent:
            was_behind = self._events & _OUT
            self._watch(reading)
            if was_behind:
                self.relieved()
        else:
            self._watch(reading | _OUT)

    def _watch(self, events: int) -> None:
        if events != self._events:
            self._events = events
            self._reactor.change(self._socket.fileno(), events)


def _nobody_waits() -> None:
    """Stands where nobody waits for relief."""


def dialled_socket() -> socket.socket:
    """Returns a socket to dial with; raises DialError if there is none to be had now."""
    try:
        return socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
    except OSError as error:
        raise DialError(f"this gateway's computer gives it no socket: {error.strerror}") from None


def watch_liveness(sock: socket.socket) -> None:
    """Has the kernel end the connection when its peer has acknowledged nothing for eight seconds.

    An idle connection is probed every two seconds; bytes that the peer's machine does not acknowledge, or that
    the peer does not read, end it after seven. This costs the process no wake-up.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 2)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 2)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 7000)
