"""A socket whose bytes are encrypted, for the loop: it never waits, and nothing waits in it that epoll does not see."""

import contextlib
import socket
import ssl
from collections.abc import Sequence

from tcpros.adapters.reactor import BUFFER_SIZE
from tcpros.adapters.tls import NO_TLS, Certificates, TlsError, reason_of

PIECE = 64 * 1024
"""So much is encrypted at once; at most this waits here for room in the kernel [bytes]."""

RECORD = 17 * 1024
"""More than the longest record that TLS has: of what has come, so much at most waits for its end [bytes]."""

_HANDSHAKE, _VERSION = 0x16, 0x03


class NoTlsError(TlsError):
    """What a client said first is no beginning of TLS."""

    def __init__(self) -> None:
        super().__init__(NO_TLS)


def begins_tls(data: memoryview | bytes) -> bool:
    """Tells whether these first bytes of a client, three at least, begin TLS.

    No connection header does: it would be longer than 65536 bytes.
    """
    return len(data) > 2 and data[0] == _HANDSHAKE and data[1] == _VERSION and data[2] > 0


class TlsSocket:
    """A connected non-blocking socket with what a `stream.Stream` needs of one, encrypted; for the relay's thread.

    Args:
        sock: the socket; the owner closes it, after `close`.
        context: whom we believe, and who we are.
        server_side: whether the other side dialled.
        buffer: where encrypted bytes are received into; only used within a call, so one serves all.
    """

    def __init__(self, sock: socket.socket, context: ssl.SSLContext, server_side: bool, buffer: memoryview) -> None:
        self._socket = sock
        self._buffer = buffer
        self._incoming, self._outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._tls = context.wrap_bio(self._incoming, self._outgoing, server_side=server_side)
        self._unsent = memoryview(b"")
        self._first = b"" if server_side else b"..."

    @property
    def has_unsent(self) -> bool:
        """Whether bytes that `send` has taken wait for room in the kernel: `flush` when there is some."""
        return bool(self._unsent)

    def shake_hands(self) -> bool:
        """Continues the handshake as far as possible now; returns whether it is done.

        Raises:
            NoTlsError: the client does not speak TLS; nothing was sent to it.
            OSError: the connection has ended, or must.
        """
        more = self._fetch(len(self._buffer))
        try:
            self._tls.do_handshake()
        except ssl.SSLWantReadError:
            if not more and not self._first:
                raise OSError(0, "") from None  # somebody who only looked whether the port answers
            if not more:
                raise TlsError("it ended the connection within the handshake") from None
            self._drain()
            return False
        except ssl.SSLError as error:
            raise self._failure(error) from None
        self._drain()
        return True

    def recv_into(self, buffer: memoryview) -> int:
        """As a socket's. All that has arrived is decrypted, so nothing is left for which no event will come.

        Raises:
            BlockingIOError: nothing has come.
            OSError: the connection has ended, or must.
        """
        more = self._fetch(len(buffer) - RECORD)
        count = 0
        try:
            while count < len(buffer) and (part := self._tls.read(len(buffer) - count, buffer[count:])):  # type: ignore[arg-type]
                count += int(part)
        except ssl.SSLWantReadError:
            pass
        except ssl.SSLZeroReturnError:
            more = False
        except ssl.SSLError as error:
            raise self._failure(error) from None
        self._drain()  # TLS itself may have been asked something
        if not count and more:
            raise BlockingIOError
        return count

    def send(self, data: memoryview | bytes, _flags: int = 0) -> int:
        """As a socket's: returns how much of the data was taken, which will go out before all else.

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
        """As a socket's and as `send`; small buffers are encrypted together."""
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
        """Sends what is still to be sent.

        Raises:
            BlockingIOError: not all of it can go now.
            OSError: the connection has ended.
        """
        if self._unsent:
            self._unsent = self._unsent[self._socket.send(self._unsent) :]
            if self._unsent:
                raise BlockingIOError

    def close(self) -> None:
        """Tells the other side, if it still listens, that this was the end."""
        with contextlib.suppress(ssl.SSLError, OSError):
            self._tls.unwrap()
        with contextlib.suppress(OSError):
            self._drain()

    def _fetch(self, most: int) -> bool:
        """Takes what has arrived, a part of it at most; False at the end of the connection."""
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
        """Sends what TLS has to say, or keeps it until there is room for it."""
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
    """Makes the encrypted sockets of one relay.

    Args:
        certificates: the fleet's.
    """

    def __init__(self, certificates: Certificates) -> None:
        self._certificates = certificates
        self._buffer = memoryview(bytearray(BUFFER_SIZE))

    def accepted(self, sock: socket.socket) -> TlsSocket:
        """For a connection that another relay dialled."""
        return TlsSocket(sock, self._certificates.server, True, self._buffer)

    def dialled(self, sock: socket.socket) -> TlsSocket:
        """For one that we dial."""
        return TlsSocket(sock, self._certificates.client, False, self._buffer)
