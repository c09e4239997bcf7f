"""Reserves free TCP ports so that two programs running in parallel never choose the same one."""

import contextlib
import socket
from collections.abc import Iterator

from pioneer_harness.error import PortError

# From here up the kernel picks ports for outgoing connections, so a free port may be taken a second later.
_FIRST_EPHEMERAL = 32768
_STRIDE = 1000


class PortReservation:
    """Holds free ports that no other reservation on this machine holds, until ``release``.

    A reservation is an abstract Unix socket named after the port. Such names live as long as the socket and are
    private to a network namespace, exactly as ports are; a killed process leaves none behind.
    """

    def __init__(self) -> None:
        self._held: dict[int, socket.socket] = {}

    def take(self, preferred: int) -> int:
        """Returns ``preferred`` if it is free, else the first free port of ``preferred`` + 1000, + 2000, …

        Raises:
            PortError: none of them is free.
        """
        for port in _candidates(preferred):
            if self._reserve(port):
                return port
        raise PortError(f"no free port: tried {preferred}, then every {_STRIDE} above it")

    def release(self) -> None:
        """Releases all reserved ports."""
        while self._held:
            self._held.popitem()[1].close()

    def __enter__(self) -> "PortReservation":
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def _reserve(self, port: int) -> bool:
        if port in self._held:
            return False
        name = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            name.bind(f"\0pioneer-port-{port}")
        except OSError:
            name.close()
            return False
        if not is_free(port):
            name.close()
            return False
        self._held[port] = name
        return True


def is_free(port: int) -> bool:
    """Returns whether a server could listen on ``port`` on all interfaces now."""
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_STREAM)) as server:
        # As ROS masters and Redis do: connections in TIME_WAIT do not matter.
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            server.bind(("", port))
            server.listen(1)
        except OSError:
            return False
        return True


def _candidates(preferred: int) -> Iterator[int]:
    yield preferred
    yield from range(preferred + _STRIDE, _FIRST_EPHEMERAL, _STRIDE)
