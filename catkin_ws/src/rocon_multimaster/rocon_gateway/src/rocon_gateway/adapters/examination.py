"""Measures what a diagnosis is made from: names, ports, clocks, interpreters, hubs on the network."""

import os
import select
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

from rocon_gateway.adapters.discovery import Discovery, own_interfaces
from rocon_gateway.adapters.hub_session import HubSession
from rocon_gateway.core.diagnosis import Contact
from rocon_gateway.core.sighting import Sighting

PATIENCE = 2.0
"""For how long a port or an announcement is waited for [s]."""


def address_of(host: str) -> str:
    """Returns the first address of a host, empty if its name does not resolve."""
    try:
        return str(socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0][4][0])
    except OSError:
        return ""


def contacts(wanted: Iterable[tuple[str, str, int]]) -> list[Contact]:
    """Tries to reach ports, given as description, host and port, all at the same time."""
    wanted = list(wanted)
    with ThreadPoolExecutor(max_workers=max(1, min(32, len(wanted)))) as pool:
        return list(pool.map(lambda one: _contact(*one), wanted))


def _contact(what: str, host: str, port: int) -> Contact:
    address = address_of(host)
    if not address:
        return Contact(what, host, port)
    try:
        socket.create_connection((address, port), PATIENCE).close()
    except OSError as error:
        return Contact(what, host, port, address, error.strerror or "no answer")
    return Contact(what, host, port, address)


def clock_offset(session: HubSession) -> float:
    """Returns how far the clock of the hub's machine is ahead of ours [s], as exact as half the way there and back."""
    best = (float("inf"), 0.0)
    for _ in range(5):
        before = time.time()
        seconds, microseconds = session.client.time()
        after = time.time()
        best = min(best, (after - before, seconds + microseconds / 1e6 - (before + after) / 2))
    return best[1]


def first_python() -> tuple[str, bool, str]:
    """Returns the first `python3` on the PATH, whether it imports rospy, and the interpreter that runs us."""
    first = shutil.which("python3") or ""
    if not first:
        return "", False, sys.executable
    tried = subprocess.run([first, "-c", "import rospy"], capture_output=True, check=False, stdin=subprocess.DEVNULL)
    return first, tried.returncode == 0, sys.executable


def announced_hubs() -> list[Sighting]:
    """Returns the hubs that announce themselves by mDNS within `PATIENCE`."""
    reader, writer = os.pipe()
    discovery = Discovery(lambda: os.write(writer, b"x") and None)
    try:
        discovery.sightings()
        select.select([reader], [], [], PATIENCE)
        return discovery.sightings()
    except OSError:
        return []
    finally:
        discovery.rest()
        os.close(reader)
        os.close(writer)


def own_addresses() -> set[str]:
    """Returns this machine's IPv4 addresses."""
    return {str(interface.ip) for interface in own_interfaces()}
