"""Open files and sockets: how many the process may have, and which of them have something to read."""

import contextlib
import resource
import select
from collections.abc import Iterable
from typing import Protocol


class HasDescriptor(Protocol):
    """A file or socket."""

    def fileno(self) -> int:
        """Returns its descriptor."""


def raise_limit() -> None:
    """Lets this process have as many open as the system allows it; what it was started with is often 1024.

    That is little: each link, subscriber and client of a service takes one.
    """
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    # Some kernels grant less than they told; then it stays as it was.
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def readable(waited: Iterable[int | HasDescriptor], seconds: float) -> set[int]:
    """Waits until one of these descriptors can be read, at most so long; returns those that can.

    Unlike `select.select`, which takes none above 1023.
    """
    poll = select.poll()
    for one in waited:
        poll.register(one, select.POLLIN)
    return {descriptor for descriptor, _ in poll.poll(max(0.0, seconds) * 1000)}
