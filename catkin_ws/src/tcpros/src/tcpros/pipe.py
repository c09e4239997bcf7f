"""Zero-copy forwarding of large messages from socket to socket with splice(2)."""

import contextlib
import errno
import fcntl
import os
from typing import NamedTuple

SIZE = 2**20
"""Requested pipe size and upper limit of one move [bytes]; the kernel's maximum for unprivileged processes."""

_NEVER = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)
_MOVE, _NONBLOCK, _MORE = 1, 2, 4  # splice(2); Python has no names for them


class Moved(NamedTuple):
    """Result of one `Pipe.move`. If both fields are empty, the source has ended."""

    taken: int  #: bytes written to the sink
    rest: bytes  #: read from the source but not accepted by the sink


class Pipe:
    """A pipe to splice bytes through. It is empty between calls, so one serves all connections."""

    def __init__(self) -> None:
        self.is_usable = (
            True  #: false once the kernel has reported that it does not support splicing here
        )
        self._out, self._in = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        with contextlib.suppress(PermissionError):
            fcntl.fcntl(self._in, fcntl.F_SETPIPE_SZ, SIZE)

    def move(self, source: int, sink: int, count: int) -> Moved:
        """Moves up to `count` bytes from one non-blocking socket to another, without waiting.

        A failed sink takes nothing; its error appears when the caller sends it the rest.

        Raises:
            BlockingIOError: the source has no data, or `is_usable` has become false; nothing was moved.
            OSError: the source has failed.
        """
        try:
            left = size = os.splice(source, self._in, min(count, SIZE), flags=_MOVE | _NONBLOCK)  # type: ignore[attr-defined]
        except OSError as error:
            if error.errno not in _NEVER:
                raise
            self.is_usable = False
            raise BlockingIOError(error.errno, error.strerror) from error
        flags = _MOVE | _NONBLOCK | (_MORE if size < count else 0)
        with contextlib.suppress(OSError):
            while left and (moved := os.splice(self._out, sink, left, flags=flags)):  # type: ignore[attr-defined]
                left -= moved
        return Moved(size - left, self._drain(left))

    def close(self) -> None:
        """Closes the pipe."""
        os.close(self._in)
        os.close(self._out)

    def _drain(self, count: int) -> bytes:
        rest = b""
        while len(rest) < count:
            rest += os.read(self._out, count - len(rest))
        return rest
