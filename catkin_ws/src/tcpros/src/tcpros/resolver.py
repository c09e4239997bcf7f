"""Non-blocking host name resolution: look-ups run in separate threads."""

import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from tcpros.error import TcprosError
from tcpros.reactor import Reactor

LIFETIME = 30.0
"""How long an address is cached [s]."""

FAILURE_LIFETIME = 2.0
"""How long it is remembered that a name does not resolve [s]."""

MAX_THREADS = 16
"""Maximum number of look-ups at a time; further names wait."""

Found = Callable[[str], None]
Failed = Callable[[str], None]


class DialError(TcprosError):
    """No socket is available for an outgoing connection: too many are open in this process or on this machine."""


@dataclass(frozen=True)
class Answer:
    """The result of a look-up."""

    until: float = 0.0  #: when it expires; monotonic [s]
    address: str = ""  #: the numeric address
    reason: str = ""  #: why the name does not resolve; empty on success


class Resolver:
    """Resolves host names to IPv4 addresses. Methods and callbacks run in the reactor's thread.

    Each name is looked up in a thread of its own, so that one that does not resolve delays no other.
    """

    def __init__(self, reactor: Reactor) -> None:
        self._reactor = reactor
        self._answers: dict[str, Answer] = {}
        self._questions: dict[str, list[tuple[Found, Failed]]] = {}
        self._waiting: deque[str] = deque()  # names without a thread yet
        self._threads = 0

    def resolve(self, host: str, found: Found, failed: Failed) -> None:
        """Calls `found` with a numeric address, immediately if it is known, or `failed` with the reason.

        If `found` raises DialError, `failed` is called too. Calls of `failed` are deferred, so that an immediate retry
        does not recurse.
        """
        if host in self._questions:
            self._questions[host].append((found, failed))
            return
        answer = self._at_once(host)
        if answer is not None:
            self._give(answer, found, failed)
            return
        self._questions[host] = [(found, failed)]
        self._waiting.append(host)
        self._start_next()

    def _at_once(self, host: str) -> Answer | None:
        if host == "localhost":
            return Answer(address="127.0.0.1")
        try:
            socket.inet_aton(host)
        except (OSError, ValueError):  # ValueError: a null character
            answer = self._answers.get(host)
            return answer if answer and time.monotonic() < answer.until else None
        return Answer(address=host)

    def _start_next(self) -> None:
        while self._waiting and self._threads < MAX_THREADS:
            host = self._waiting.popleft()
            self._threads += 1
            thread = threading.Thread(
                target=self._look_up, args=(host,), name="relay-resolver", daemon=True
            )
            try:
                thread.start()
            except RuntimeError as error:  # no more threads on this machine
                answer = Answer(reason=f"the name {host} cannot be resolved: {error}")
                self._reactor.call(partial(self._take, host, answer))

    def _look_up(self, host: str) -> None:
        """Runs in the name's thread."""
        try:
            answers = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM)
            answer = Answer(time.monotonic() + LIFETIME, address=str(answers[0][4][0]))
        except (OSError, ValueError) as error:
            # A name server that does not answer is not asked again.
            if getattr(error, "errno", None) != socket.EAI_AGAIN and _has_ipv6(host):
                reason = (
                    f"{host} has an IPv6 address only, and only IPv4 is supported: unset ROS_IPV6 where the node runs, "
                    "or set ROS_IP to an IPv4 address there"
                )
            else:
                reason = f"the name {host} cannot be resolved: {getattr(error, 'strerror', None) or error}"
            answer = Answer(time.monotonic() + FAILURE_LIFETIME, reason=reason)
        self._reactor.call(partial(self._take, host, answer))

    def _take(self, host: str, answer: Answer) -> None:
        self._threads -= 1
        now = time.monotonic()
        self._answers = {name: known for name, known in self._answers.items() if now < known.until}
        self._answers[host] = answer
        for found, failed in self._questions.pop(host):
            self._reactor.call(partial(self._give, answer, found, failed))
        self._start_next()

    def _give(self, answer: Answer, found: Found, failed: Failed) -> None:
        reason = answer.reason
        if not reason:
            try:
                found(answer.address)
            except DialError as error:
                reason = str(error)
        if reason:
            self._reactor.call(partial(failed, reason))


def _has_ipv6(host: str) -> bool:
    try:
        return bool(socket.getaddrinfo(host, None, socket.AF_INET6, socket.SOCK_STREAM))
    except (OSError, ValueError):
        return False
