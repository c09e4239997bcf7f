"""A non-blocking TLS socket for the reactor. It buffers no received data, so epoll sees everything that is pending."""

import contextlib
import socket
import ssl
from collections.abc import Sequence

from tcpros.reactor import BUFFER_SIZE
from tcpros.tls import NO_TLS, Certificates, TlsError, reason_of

PIECE = 64 * 1024
"""Most bytes encrypted at once, and so the most that wait here for room in the kernel's buffer [bytes]."""

RECORD = 17 * 1024
"""More than the longest TLS record: the most received data that can wait for the end of its record [bytes]."""

_HANDSHAKE, _VERSION = 0x16, 0x03


class NoTlsError(TlsError):
    """The first bytes of a client are not TLS."""

    def __init__(self) -> None:
        super().__init__(NO_TLS)


def begins_tls(data: memoryview | bytes) -> bool:
    """Returns whether a client's first bytes, at least three, begin a TLS handshake.

    No connection header looks like this: its length would exceed 65536 bytes.
    """
    return len(data) > 2 and data[0] == _HANDSHAKE and data[1] == _VERSION and data[2] > 0


class TlsSocket:
    """A connected non-blocking socket with TLS, for `stream.Stream`; use it in the relay's thread only.

    Args:
        sock: the socket; the owner closes it after `close`.
        context: our certificate and the trusted authority.
        server_side: whether the other side connected to us.
        buffer: receive buffer for encrypted data; only used within a call, so all sockets can share one.
    """

    def __init__(
        self, sock: socket.socket, context: ssl.SSLContext, server_side: bool, buffer: memoryview
    ) -> None:
        self._socket = sock
        self._buffer = buffer
        self._incoming, self._outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._tls = context.wrap_bio(self._incoming, self._outgoing, server_side=server_side)
        self._unsent = memoryview(b"")
        self._first = b"" if server_side else b"..."

    @property
    def has_unsent(self) -> bool:
        """Whether bytes taken by `send` wait for room in the kernel; call `flush` when there is room."""
        return bool(self._unsent)

    def shake_hands(self) -> bool:
        """Continues the handshake without blocking; returns whether it is complete.

        Raises:
            NoTlsError: the client does not speak TLS; nothing was sent to it.
            OSError: the connection has ended or must be closed.
        """
        more = self._fetch(len(self._buffer))
        try:
            self._tls.do_handshake()
        except ssl.SSLWantReadError:
            if not more and not self._first:
                raise OSError(0, "") from None  # a client that only probed the port
            if not more:
                raise TlsError("it ended the connection within the handshake") from None
            self._drain()
            return False
        except ssl.SSLError as error:
            raise self._failure(error) from None
        self._drain()
        return True

    def recv_into(self, buffer: memoryview) -> int:
        """Like `socket.recv_into`. Decrypts all data read, so no data is left that epoll does not report.

        Raises:
            BlockingIOError: no data has arrived.
            OSError: the connection has ended or must be closed.
        """
        more = self._fetch(len(buffer) - RECORD)
        count = 0
        try:
            while count < len(buffer):
                part = self._tls.read(len(buffer) - count, buffer[count:])  # type: ignore[arg-type]
                if not part:
                    break
                count += int(part)
        except ssl.SSLWantReadError:
            pass
        except ssl.SSLZeroReturnError:
            more = False
        except ssl.SSLError as error:
            raise self._failure(error) from None
        self._drain()  # TLS may have a protocol reply to send
        if not count and more:
            raise BlockingIOError
        return count

    def send(self, data: memoryview | bytes, _flags: int = 0) -> int:
        """Like `socket.send`: returns how many bytes were taken. These are sent before any later data.

        Raises:
            BlockingIOError: the kernel has no room.
            OSError: the connection has ended.
        """
        self.flush()
        sent, size, data = 0, len(data), memoryview(data)
        while sent < size and not self._unsent:
            sent += self._tls.write(data[sent : sent + PIECE])
            self._drain()
        return sent

    def sendmsg(self, buffers: Sequence[memoryview]) -> int:
        """Like `socket.sendmsg`, see also `send`; small buffers are encrypted together."""
        if len(buffers[0]) >= PIECE:
            return self.send(buffers[0])
        self.flush()
        together = bytearray()
        for buffer in buffers:
            if together and len(together) + len(buffer) > PIECE:
                break
            together += buffer
        return self.send(together)

    def flush(self) -> None:
        """Sends pending encrypted data.

        Raises:
            BlockingIOError: not all of it could be sent.
            OSError: the connection has ended.
        """
        if self._unsent:
            self._unsent = self._unsent[self._socket.send(self._unsent) :]
            if self._unsent:
                raise BlockingIOError

    def close(self) -> None:
        """Notifies the peer of the end of the TLS connection, if possible."""
        with contextlib.suppress(ssl.SSLError, OSError):
            self._tls.unwrap()
        with contextlib.suppress(OSError):
            self._drain()

    def _fetch(self, most: int) -> bool:
        """Reads up to `most` encrypted bytes; returns False at the end of the connection."""
        try:
            count = self._socket.recv_into(self._buffer[:most])
        except BlockingIOError:
            return True
        if not count:
            return False
        if len(self._first) < 3:
            self._first = (self._first + bytes(self._buffer[: min(count, 3)]))[:3]
            if len(self._first) == 3 and not begins_tls(self._first):
                raise NoTlsError
        self._incoming.write(self._buffer[:count])
        return True

    def _drain(self) -> None:
        """Sends the output of TLS, or keeps it until the kernel has room."""
        if self._outgoing.pending:
            self._unsent = memoryview(bytes(self._unsent) + self._outgoing.read())
        if self._unsent:
            with contextlib.suppress(BlockingIOError):
                self.flush()

    def _failure(self, error: ssl.SSLError) -> TlsError:
        """Returns what to raise, after sending the reason to the peer if possible."""
        with contextlib.suppress(OSError):
            self._drain()
        return TlsError(reason_of(error))


class Tls:
    """Creates the TLS sockets of one relay.

    Args:
        certificates: the fleet's certificates.
    """

    def __init__(self, certificates: Certificates) -> None:
        self._certificates = certificates
        self._buffer = memoryview(bytearray(BUFFER_SIZE))

    def accepted(self, sock: socket.socket) -> TlsSocket:
        """Returns a TLS socket for an incoming connection."""
        return TlsSocket(sock, self._certificates.server, True, self._buffer)

    def dialled(self, sock: socket.socket) -> TlsSocket:
        """Returns a TLS socket for an outgoing connection."""
        return TlsSocket(sock, self._certificates.client, False, self._buffer)
