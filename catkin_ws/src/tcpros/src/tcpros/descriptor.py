"""File descriptors: raises the limit of the process, and waits until some are readable."""

import contextlib
import resource
import select
from collections.abc import Iterable
from typing import Protocol


class HasDescriptor(Protocol):
    """A file or socket."""

    def fileno(self) -> int:
        """Returns the descriptor."""


def raise_limit() -> None:
    """Raises this process' limit of open descriptors to the hard limit. The default is often 1024.

    That is not enough: each link, subscriber and service client takes one.
    """
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    # Some kernels grant less than the reported hard limit; then the limit stays as it was.
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def readable(waited: Iterable[int | HasDescriptor], seconds: float) -> set[int]:
    """Waits up to `seconds` until at least one descriptor is readable; returns the readable ones.

    Unlike `select.select`, it works for descriptors above 1023.
    """
    poll = select.poll()
    for one in waited:
        poll.register(one, select.POLLIN)
    return {descriptor for descriptor, _ in poll.poll(max(0.0, seconds) * 1000)}
