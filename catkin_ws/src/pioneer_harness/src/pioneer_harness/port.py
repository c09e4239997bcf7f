"""Reserves free TCP ports so that two programs running in parallel never choose the same one."""

import socket

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
        self._held: list[socket.socket] = []

    def take(self, preferred: int) -> int:
        """Returns ``preferred`` if it is free, else the first free port of ``preferred`` + 1000, + 2000, …

        Raises:
            PortError: none of them is free.
        """
        for port in (preferred, *range(preferred + _STRIDE, _FIRST_EPHEMERAL, _STRIDE)):
            if (name := claimed(f"pioneer-port-{port}")) is not None:
                if is_free(port):
                    self._held.append(name)
                    return port
                name.close()
        raise PortError(f"no free port: tried {preferred}, then every {_STRIDE} above it")

    def release(self) -> None:
        """Releases all reserved ports."""
        while self._held:
            self._held.pop().close()

    def __enter__(self) -> "PortReservation":
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def claimed(name: str) -> socket.socket | None:
    """Returns a socket with this abstract name, which is taken until it is closed; None if another socket has it."""
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        claim.bind(f"\0{name}")
    except OSError:
        claim.close()
        return None
    return claim


def is_free(port: int) -> bool:
    """Returns whether a server could listen on ``port`` on all interfaces now."""
    try:
        # With SO_REUSEADDR, as ROS masters and Redis do: connections in TIME_WAIT do not matter.
        socket.create_server(("", port)).close()
    except OSError:
        return False
    return True
