"""From socket to socket within the kernel: large messages that need not be seen."""

import contextlib
import errno
import fcntl
import os
from typing import NamedTuple

SIZE = 2**20
"""What is asked of the kernel, and moved at most in one call [bytes]; the most that it grants anybody."""

_NEVER = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)
_MOVE, _NONBLOCK, _MORE = 1, 2, 4  # splice(2); Python has no names for them


class Moved(NamedTuple):
    """What became of the bytes of one `Pipe.move`."""

    taken: int  #: how many the sink has; none, and no rest: the source has ended
    rest: bytes  #: those that the source gave and the sink did not take


class Pipe:
    """A pipe that bytes are spliced through. It is empty between two calls, so one serves all connections."""

    def __init__(self) -> None:
        self.is_usable = True  #: false once the kernel has said that it cannot do it
        self._out, self._in = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        with contextlib.suppress(PermissionError):
            fcntl.fcntl(self._in, fcntl.F_SETPIPE_SZ, SIZE)

    def move(self, source: int, sink: int, count: int) -> Moved:
        """Moves at most `count` bytes from one non-blocking socket to another, as far as these go now.

        A sink that fails takes nothing: it says why when the rest is sent to it.

        Raises:
            BlockingIOError: the source has nothing, or `is_usable` is false now; nothing was moved.
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
