"""Sends hostile bytes to the ports of a fleet (relays, hub, slave APIs of the nodes) until interrupted.

Run it as ``wire.py SEED RATE TARGET=HOST:PORT…``; each second it writes a line of JSON with the number of inputs per
target.
"""

import contextlib
import random
import signal
import socket
import sys
import threading
import time
from collections import Counter, deque

import hostile
from figures import tell

from rocon_hub_protocol.password import password_from
from rocon_hub_protocol.redis_client import NotOurHubError, prove

SPEECH = {
    "relay": hostile.hello,
    "hub": hostile.proof,
    "slave": hostile.request,
    "tcpros": hostile.hello,
}
LEFT_OPEN = 30
"""Number of connections that are kept open after an incomplete message."""
PATIENCE = 2.0


def meet(rng: random.Random, target: str, address: tuple[str, int]) -> socket.socket:
    """Connects, sends something hostile, reads part of the answer, and returns the connection."""
    connection = socket.create_connection(address, PATIENCE)
    connection.settimeout(0.05)
    with contextlib.suppress(OSError):
        if target == "member":
            prove(connection, password())
            connection.sendall(rng.choice(hostile.COMMANDS).encode() + b"\r\n")
        else:
            connection.sendall(SPEECH[target](rng))
        connection.recv(65536)
    return connection


def password() -> str:
    """Returns the fleet's password, or "" if it has none."""
    known = password_from("")
    return known() if known else ""


def main() -> None:
    """Runs until SIGINT."""
    seed, rate, *words = sys.argv[1:]
    targets = [(word.partition("=")[0], word.partition("=")[2].rpartition(":")) for word in words]
    rng, counts, kept, told = random.Random(int(seed)), Counter[str](), deque[socket.socket](), 0.0
    end = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: end.set())
    while not end.wait(1.0 / float(rate)):
        target, (host, _, port) = rng.choice(targets)
        with contextlib.suppress(OSError, NotOurHubError):
            kept.append(meet(rng, target, (host, int(port))))
            counts[target] += 1
        while len(kept) > LEFT_OPEN or (kept and rng.random() < 0.8):
            kept.popleft().close()
        if time.monotonic() - told > 1.0:
            told = time.monotonic()
            tell(counts)


main()
