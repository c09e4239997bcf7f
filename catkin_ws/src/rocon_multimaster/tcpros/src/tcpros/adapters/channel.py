"""A non-blocking TCP connection in the reactor: connect, TLS handshake, send, close. `stream` adds receiving."""

import os
import select
import socket
import struct
from collections.abc import Callable

from tcpros.adapters.reactor import Reactor
from tcpros.adapters.resolver import DialError
from tcpros.adapters.tls_socket import NoTlsError, TlsSocket
from tcpros.core.backlog import Backlog
from tcpros.core.fanout import DirectSink, Pressure
from tcpros.core.frame import Chunk

_IN, _OUT = select.EPOLLIN, select.EPOLLOUT
_FAILED = select.EPOLLERR | select.EPOLLHUP
_ACKED = struct.Struct("=120xQ")  # the beginning of Linux's tcp_info, up to tcpi_bytes_acked
_RECEIVED = struct.Struct("=128xQ")  # the same, up to tcpi_bytes_received


class Channel:
    """The sending side of one connection: a `core.fanout.Outlet` that is its own `Pressure` and `DirectSink`.

    Subclasses override `readable` and `is_reading`, and may override `connected`, `without_tls`, `closed` and `left`.

    Args:
        reactor: the loop.
        sock: the connection.
        peer: the other end, for log lines.
        tls: encrypts the connection; None for plain TCP.
    """

    def __init__(self, reactor: Reactor, sock: socket.socket, peer: str, tls: TlsSocket | None = None) -> None:
        self.backlog = Backlog(1, 0)  #: queued data
        self.peer = peer  #: the other end, for log lines
        self.relieved: Callable[[], None] = _do_nothing  #: called when the queue has been sent completely
        self.is_closed = False  #: whether `close` was called
        self._reactor = reactor
        self._socket = sock
        self._tls = tls
        self._wire: socket.socket | TlsSocket = tls or sock
        self._connecting = False
        self._shaking = tls is not None
        self._finishing = False
        self._events = _IN
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        reactor.add(sock.fileno(), self, _IN)

    @property
    def pressure(self) -> Pressure:
        """The channel itself."""
        return self

    @property
    def direct(self) -> DirectSink | None:
        """The channel itself, unless it is encrypted."""
        return self if self._tls is None else None

    @property
    def is_full(self) -> bool:
        """Whether the peer is behind."""
        return self.backlog.is_full

    @property
    def is_reading(self) -> bool:
        """Whether to wait for data to read."""
        return True

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

    def readable(self) -> None:
        """Called when data can be read or the connection has ended."""

    def without_tls(self) -> None:
        """Called when the peer does not speak TLS although it should. The channel has switched to plain TCP by then."""
        self.close(NoTlsError().strerror)

    def closed(self, reason: str) -> None:
        """Called once, after the connection has ended for any reason."""

    def left(self) -> None:
        """Called when the frame being sent at the time of `Fanout.leave` is complete."""

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
            self.readable()

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
        except BlockingIOError:
            count = 0
        except OSError as error:
            self.close(_reason(error))
            return
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
            except BlockingIOError:
                pass
            except OSError as error:
                self.close(_reason(error))
                return
        if sent < len(data):
            self.backlog.insert(bytes(data[sent:]))
        self.update_events()

    def finish(self, data: bytes) -> None:
        """Sends the last bytes and closes once they are sent."""
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
        except BlockingIOError:
            pass
        except OSError as error:
            self.close(_reason(error))
            return
        if self._finishing and self._is_sent:
            self.close("")
        else:
            self.update_events()

    def close(self, reason: str) -> None:
        """Ends the connection; a second call does nothing."""
        if self.is_closed:
            return
        self.is_closed = True
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
            self.close(_reason(error))
            return
        if self._shaking:
            self._watch(_IN | _OUT if self._tls.has_unsent else _IN)
            return
        self._established()
        if not self.is_closed:
            self.readable()  # data may have arrived together with the end of the handshake

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


def _do_nothing() -> None:
    """The default callback."""


def _reason(error: OSError) -> str:
    return error.strerror or str(error)


def dialled_socket() -> socket.socket:
    """Returns a socket for an outgoing connection. Raises DialError if no socket is available."""
    try:
        return socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
    except OSError as error:
        raise DialError(f"no socket available on this gateway's computer: {error.strerror}") from None


def watch_liveness(sock: socket.socket) -> None:
    """Makes the kernel close the connection if the peer acknowledges nothing for eight seconds.

    An idle connection is probed every two seconds. Data that the peer's host does not acknowledge, or that the peer
    does not read, closes it after seven. The process is never woken for this.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 2)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 2)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 7000)  # type: ignore[attr-defined]
