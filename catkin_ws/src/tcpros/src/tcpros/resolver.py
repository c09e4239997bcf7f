"""Non-blocking host name resolution: look-ups run in one separate thread, started on first use."""

import queue
import socket
import threading
import time
from collections.abc import Callable

from tcpros.error import TcprosError
from tcpros.reactor import Reactor

LIFETIME = 30.0
"""How long a result is cached [s]."""

Found = Callable[[str], None]
Failed = Callable[[str], None]


class DialError(TcprosError):
    """No socket is available for an outgoing connection: too many are open in this process or on this machine."""


class Resolver:
    """Resolves host names to IPv4 addresses. Methods and callbacks run in the reactor's thread."""

    def __init__(self, reactor: Reactor) -> None:
        self._reactor = reactor
        self._known: dict[str, tuple[float, str]] = {}
        self._questions: queue.SimpleQueue[tuple[str, Found, Failed]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def resolve(self, host: str, found: Found, failed: Failed) -> None:
        """Calls `found` with a numeric address, immediately if it is known, or `failed` with the reason.

        If `found` raises DialError, `failed` is called too. That call is deferred, so that an immediate retry does not
        recurse.
        """
        address = self._at_once(host)
        if address:
            self._give(address, found, failed)
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="relay-resolver", daemon=True)
            self._thread.start()
        self._questions.put((host, found, failed))

    def _at_once(self, host: str) -> str:
        if host == "localhost":
            return "127.0.0.1"
        try:
            socket.inet_aton(host)
        except OSError:
            until, address = self._known.get(host, (0.0, ""))
            return address if time.monotonic() < until else ""
        return host

    def _run(self) -> None:
        while True:
            host, found, failed = self._questions.get()
            try:
                answers = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM)
                address = str(answers[0][4][0])
                self._reactor.call(lambda h=host, a=address, f=found, e=failed: self._remember(h, a, f, e))
            except (OSError, UnicodeError) as error:
                reason = f"the name {host} cannot be resolved: {getattr(error, 'strerror', None) or error}"
                self._reactor.call(lambda f=failed, r=reason: f(r))

    def _remember(self, host: str, address: str, found: Found, failed: Failed) -> None:
        self._known[host] = (time.monotonic() + LIFETIME, address)
        self._give(address, found, failed)

    def _give(self, address: str, found: Found, failed: Failed) -> None:
        try:
            found(address)
        except DialError as error:
            reason = str(error)
            self._reactor.call(lambda: failed(reason))
