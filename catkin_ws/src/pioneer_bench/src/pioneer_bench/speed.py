"""How fast the machine is at the moment: three fixed pieces of work, timed before and after each bench.

None of them runs code of this project, so that a change of it does not change them. Each is repeated, and the least
time counts: it is the one that other programs on the machine disturbed least.
"""

import os
import socket
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

_REPETITIONS = 7
_LOOPS = 200_000
_NUMBERS = 200_000
_ROUND_TRIPS = 500
_MESSAGE = 100


@dataclass(frozen=True, slots=True)
class Speed:
    """Times of the three pieces of work; a slower machine has greater ones."""

    python: float  #: a loop of the interpreter [CPU-s]
    kernel: float  #: compiled code over an array [CPU-s]
    socket: float  #: round trips of small messages to another process over TCP [wall s]

    def as_dict(self) -> dict[str, float]:
        """Returns the times for JSON."""
        return asdict(self)


def measured() -> Speed:
    """Measures the machine; takes about half a second."""
    return Speed(
        python=_least(_interpreted, time.process_time),
        kernel=_least(_compiled, time.process_time),
        socket=_round_trips(),
    )


def _least(work: Callable[[], object], clock: Callable[[], float]) -> float:
    times = []
    for _ in range(_REPETITIONS):
        began = clock()
        work()
        times.append(clock() - began)
    return min(times)


def _interpreted() -> int:
    total = 0
    for number in range(_LOOPS):
        total += number & 7
    return total


def _compiled() -> object:
    return np.sort(np.random.default_rng(1).random(_NUMBERS))


def _round_trips() -> float:
    """Returns the least time of a number of round trips to a child process."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        child = os.fork()
        if not child:
            _answer(server)
        with socket.create_connection(server.getsockname()) as connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            try:
                return _least(lambda: _exchange(connection), time.perf_counter)
            finally:
                connection.shutdown(socket.SHUT_RDWR)
                os.waitpid(child, 0)


def _exchange(connection: socket.socket) -> None:
    message = bytes(_MESSAGE)
    for _ in range(_ROUND_TRIPS):
        connection.sendall(message)
        connection.recv(_MESSAGE, socket.MSG_WAITALL)


def _answer(server: socket.socket) -> None:
    """Echoes what one client sends, in the child process, until the client ends."""
    try:
        connection, _ = server.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while message := connection.recv(_MESSAGE, socket.MSG_WAITALL):
            connection.sendall(message)
    finally:
        os._exit(0)
